"""Reading of regular files with a size limit, and atomic writing.

All readers of the package open files here; FIFOs, devices and folders are rejected.

A file is written to a temporary file in the same folder, flushed to disk and renamed, so a crash leaves
the old file or the new one, never half of one. A symbolic link is kept, and its target is replaced.
"""

from __future__ import annotations

import codecs
import errno
import gzip
import os
import secrets
import stat
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from rr1plan.checks import file_path, resolved_path
from rr1plan.errors import FormatError, InputError

MAX_BYTES = 256 * 1024 * 1024
# Without O_NONBLOCK opening a FIFO waits for a writer. It has no effect on regular files.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_KINDS = {stat.S_IFDIR: "folder", stat.S_IFIFO: "FIFO", stat.S_IFCHR: "device", stat.S_IFBLK: "device"}

# What a clone of a repository without Git LFS has in place of large files, such as meshes.
_LFS_POINTER = b"version https://git-lfs.github.com/spec/"


def read_bytes(file: str | Path, max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a regular file, decompressed if its name ends in ".gz".

    Args:
        file: The file.
        max_bytes: Largest size, compressed or decompressed.

    Raises:
        InputError: not a file name.
        FormatError: not there, not a regular file, not readable, too large, a damaged archive, or a pointer of Git LFS.
    """
    path = file_path(file)
    try:
        with _open(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            with gzip.GzipFile(fileobj=stream) if path.suffix.lower() == ".gz" else stream as content:
                data = b"" if size > max_bytes else content.read(max_bytes + 1)
    except FileNotFoundError as error:
        raise FormatError("there is no such file", path) from error
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"cannot be read: {getattr(error, 'strerror', None) or error}", path) from error
    if max(size, len(data)) > max_bytes:
        raise FormatError(f"is larger than {max_bytes} bytes, the most that is read", path)
    if data.startswith(_LFS_POINTER):
        raise FormatError("is a pointer of Git LFS in place of the file: fetch the file by 'git lfs pull'", path)
    return data


def _open(path: Path) -> BinaryIO:
    """A regular file, opened for reading."""
    handle = os.open(path, _FLAGS)
    mode = os.fstat(handle).st_mode
    if not stat.S_ISREG(mode):
        os.close(handle)
        kind = _KINDS.get(stat.S_IFMT(mode), "special file")
        raise FormatError(f"is a {kind}, expected a regular file", path)
    return os.fdopen(handle, "rb")


def content_suffix(file: str | Path) -> str:
    """The suffix of a file in lower case; of one whose name ends in ".gz", that of its decompressed content."""
    path = file_path(file)
    return Path(path.stem).suffix.lower() if path.suffix.lower() == ".gz" else path.suffix.lower()


def text_stem(file: str | Path) -> str:
    """The name of a file without its suffix; bytes that are not UTF-8 become replacement characters."""
    return os.fsencode(Path(file).stem).decode(errors="replace")


def is_regular(path: Path) -> bool:
    """Whether there is a regular file of this name; False for an invalid name."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_text(file: str | Path, max_bytes: int = MAX_BYTES, *, strict: bool = True) -> str:
    """A UTF-8 file's text without a byte order mark, which spreadsheets and editors may write; see `read_bytes`.

    Args:
        file: The file.
        max_bytes: Largest size, as of `read_bytes`.
        strict: Whether to refuse bytes that are not UTF-8; otherwise they become replacement characters.

    Raises:
        FormatError: as `read_bytes`, UTF-16, or not UTF-8.
    """
    data = read_bytes(file, max_bytes)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise FormatError("is UTF-16, not UTF-8 text: save it as UTF-8 (in PowerShell, Out-File -Encoding utf8)", file)
    try:
        return data.decode("utf-8-sig", "strict" if strict else "replace")
    except UnicodeDecodeError as error:
        raise FormatError(f"is not UTF-8 text (byte {error.start})", file) from error


def write_text(file: str | os.PathLike[str], text: str) -> Path:
    """Write a UTF-8 file atomically and return its path; see `write_bytes`."""
    return write_bytes(file, text.encode("utf-8"))


def check_writable(file: str | os.PathLike[str], *suffixes: str) -> Path:
    """The path of a file that can be written, before its content is computed.

    Args:
        file: The file.
        suffixes: Accepted endings of its name, in lower or upper case (default: any).

    Raises:
        InputError: not a file name, that of a folder or device, one in a folder that is missing or not writeable, or
            another suffix.
    """
    path = file_path(file)
    try:
        _refuse_to_replace(path)
        tempfile.TemporaryFile(dir=resolved_path(path).parent).close()
    except OSError as error:
        raise _not_written(path, error) from error
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"cannot save {str(path)!r}, expected a name that ends in {' or '.join(suffixes)}")
    return path


def make_folder(folder: str | Path, file: str) -> Path:
    """Make a folder, and those above it, unless they exist.

    Args:
        folder: The folder.
        file: Name of a file that will be written there.

    Raises:
        InputError: it cannot be created, or the file could not be written.
    """
    path = file_path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        there = next(part for part in (path, *path.parents) if part.exists())
        why = error.strerror if there.is_dir() else f"{there} is a file, expected a folder or a new name"
        raise InputError(f"cannot make the folder {path}: {why}") from error
    check_writable(path / file)
    return path


def _refuse_to_replace(path: Path) -> None:
    """Reject a folder, a FIFO or a device, because renaming would replace it."""
    if path.exists() and not path.is_file():
        kind = _KINDS.get(stat.S_IFMT(path.stat().st_mode), "special file")
        raise InputError(f"cannot write {path}: it is a {kind}, expected a regular file or a new name")


def _not_written(path: Path, error: OSError) -> InputError:
    """The error for a file that cannot be written."""
    folders = (path.parent, resolved_path(path).parent)  # of a symbolic link that of its target, too
    missing = [folder for folder in folders if error.errno == errno.ENOENT and not folder.exists()]
    return InputError(f"cannot write {path}: {f'there is no folder {missing[0]}' if missing else error.strerror}")


@contextmanager
def writing(file: str | Path) -> Iterator[None]:
    """Name the file that cannot be written, as on a full disk."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from error


def write_bytes(file: str | os.PathLike[str], data: bytes) -> Path:
    """Write a file atomically and return its path.

    Raises:
        InputError: not a file name, that of a folder or device, or the folder is missing or not writeable; an old file
            is unchanged.
    """
    path = file_path(file)
    target = resolved_path(path)
    temporary = target.with_name(f".rr1plan.{secrets.token_hex(8)}.tmp")
    try:
        _refuse_to_replace(path)
        old_mode = target.stat().st_mode & 0o777 if target.exists() else None
        # The system applies the umask, which a process cannot read without changing it for all of its threads.
        handle = os.open(temporary, _NEW_FILE, 0o666 if old_mode is None else old_mode)
    except OSError as error:
        raise _not_written(path, error) from error
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if old_mode is not None:
            temporary.chmod(old_mode)
        temporary.replace(target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise _not_written(path, error) from error
        raise
    return path
