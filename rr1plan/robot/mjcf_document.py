"""An MJCF document as one checked text for MuJoCo's parser, which opens no files.

MuJoCo's parser is native code that follows includes, loads meshes and textures and expands macros. Therefore the
elements are read here first, within bounds. Includes are resolved and stay inside the robot's folders, mesh files
become names that `mjcf_model` reads with the package's own readers, and everything that does not affect kinematics,
masses, shapes or contacts is omitted. Each element has its own line in the text, so that MuJoCo's messages can refer to
the line of the file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.sax.saxutils import quoteattr

from rr1plan.checks import file_path
from rr1plan.errors import FormatError, InputError
from rr1plan.files.file_access import is_regular, read_bytes
from rr1plan.files.xml_reader import MAX_BYTES, MAX_DEPTH, Element, parse_xml, root_tag
from rr1plan.robot.mesh_lookup import MeshLookup

# Elements after expansion of includes and replicas. The largest hands and humanoids have some 3,000.
MAX_ELEMENTS = 20_000
MAX_FILES = 100

# Content that affects neither kinematics nor contacts. Some of it would open files or plugins.
_LEFT_OUT = {
    "": ("option", "size", "visual", "statistic", "custom", "sensor", "extension"),
    "asset": ("texture", "skin"),
    "material": ("layer",),
    "compiler": ("lengthrange",),
    "actuator": ("plugin",),
}
_LEFT_OUT_ANYWHERE = ("camera", "light", "plugin")
# Soft or generated bodies and height fields, omitted with a warning.
_NOT_READ = ("composite", "flexcomp", "deformable", "flex", "hfield")
_ATTRIBUTES_LEFT_OUT = {
    "compiler": ("meshdir", "texturedir", "assetdir", "strippath", "fusestatic", "discardvisual"),
    "material": ("texture",),
    "mesh": ("file", "content_type"),
}
# A keyframe only provides the configuration that it names.
_KEY_ATTRIBUTES = ("name", "qpos")
_BODIES = ("worldbody", "body", "frame", "replicate")
# Attributes with names or words, which may be "nan".
_WORDS = re.compile(r"name|class|childclass|body[12]?|geom[12]?|joint[12]?|site[12]?|mesh|material|tendon[12]?|model")


@dataclass(frozen=True)
class MeshFile:
    """A mesh asset with a file: its element, and the places where the file may be."""

    element: Element
    name: str
    places: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class Document:
    """The text for MuJoCo's parser.

    Args:
        file: The main file.
        root: Its outermost element, with includes expanded.
        text: The document.
        lines: The element that begins in each line of the text, or None.
        meshes: The mesh assets that have a file, by name.
        not_read: Kinds of omitted elements that may matter, in order.
    """

    file: Path
    root: Element
    text: str
    lines: tuple[Element | None, ...]
    meshes: dict[str, MeshFile]
    not_read: tuple[str, ...]

    def error(self, message: str, line: int | None = None) -> FormatError:
        """A `FormatError` about the file, at the element of a line of the text if one is given."""
        element = self.lines[line - 1] if line is not None and 0 < line <= len(self.lines) else None
        return FormatError(message, self.file) if element is None else element.error(message)


def read_document(file: Path, lookup: MeshLookup) -> Document:
    """Read an MJCF file and its includes.

    Args:
        file: The file.
        lookup: The robot's folders.

    Raises:
        FormatError: a file that is not MJCF, is too large or leaves its folders, a number that is not finite, or a part
            of another model file.
    """
    data = read_bytes(file, MAX_BYTES)
    root = parse_xml(data, None, file)
    if root.tag == "mujocoinclude":
        raise root.error("is a part that other MJCF files include; load the file that includes it")
    if root.tag != "mujoco":
        raise root.error(f"the outermost element is <{root.tag}>, expected <mujoco>")
    _Includes(file, lookup, len(data)).resolve(root)
    _check_size(root)
    writer = _Writer(file, lookup, *_mesh_folder(root))
    writer.write(root, "", 0)
    return Document(
        file, root, "\n".join(writer.texts), tuple(writer.lines), writer.meshes, tuple(dict.fromkeys(writer.not_read))
    )


class _Includes:
    """Inserts the elements of included files, each file once, as MuJoCo does."""

    def __init__(self, file: Path, lookup: MeshLookup, size: int) -> None:
        self.folder = file.parent
        self.lookup = lookup
        self.size = size
        self.seen = {file.resolve()}

    def resolve(self, element: Element, folder: Path | None = None) -> None:
        """Replace the includes below an element that was read from a file in `folder`."""
        children: list[Element] = []
        for child in element.children:
            if child.tag == "include":
                children.extend(self._included(child, folder or self.folder))
            else:
                self.resolve(child, folder)
                children.append(child)
        element.children[:] = children

    def _included(self, element: Element, folder: Path) -> list[Element]:
        name = element.text("file")
        try:
            relative = file_path(name)
        except InputError as error:
            raise element.error(f"an included {error}") from error
        # Relative to the main file, else to the file that includes it.
        try:
            file = self.lookup.first(f"included file {name!r}", (self.folder / relative, folder / relative))
        except FormatError as error:
            raise element.error(str(error)) from error
        if file.resolve() in self.seen:
            raise element.error(f"includes {name!r} a second time, which MJCF does not allow")
        self.seen.add(file.resolve())
        if len(self.seen) > MAX_FILES:
            raise element.error(f"includes more than {MAX_FILES} files")
        data = read_bytes(file, MAX_BYTES)
        self.size += len(data)
        if self.size > MAX_BYTES:
            raise element.error(f"is larger than {MAX_BYTES} bytes with what it includes")
        root = parse_xml(data, None, file)
        self.resolve(root, file.parent)
        return root.children


def _check_size(root: Element) -> None:
    """Reject documents that are nested too deep or expand to too many elements."""
    count = 0
    waiting = [(root, 1, 1)]
    while waiting:
        element, depth, copies = waiting.pop()
        count += copies
        if depth > MAX_DEPTH:
            raise element.error(f"elements are nested deeper than {MAX_DEPTH}")
        if element.tag == "replicate":
            copies *= _replicas(element)
        if count > MAX_ELEMENTS or copies > MAX_ELEMENTS:
            raise element.error(f"the model has more than {MAX_ELEMENTS} elements, the most that are read")
        waiting.extend((child, depth + 1, copies) for child in element.children)


def _replicas(element: Element) -> int:
    count = element.number("count")
    if not 1 <= count <= MAX_ELEMENTS or count != int(count):
        raise element.error(f"<replicate> count={element.attributes['count']!r}, expected 1 to {MAX_ELEMENTS}")
    return int(count)


def _mesh_folder(root: Element) -> tuple[str, bool]:
    """The folder of mesh files, and whether theirs are ignored; later compiler elements override earlier ones."""
    folder, strips = "", "false"
    for element in root.all("compiler"):
        folder = element.attributes.get("meshdir", element.attributes.get("assetdir", folder))
        strips = element.attributes.get("strippath", strips)
    return folder, strips == "true"


@dataclass(eq=False)
class _Writer:
    """Writes the relevant elements, each in its own line."""

    file: Path
    lookup: MeshLookup
    mesh_folder: str
    strip_path: bool
    texts: list[str] = field(default_factory=list)
    lines: list[Element | None] = field(default_factory=list)
    meshes: dict[str, MeshFile] = field(default_factory=dict)
    not_read: list[str] = field(default_factory=list)

    def write(self, element: Element, parent: str, depth: int) -> None:
        """Write an element below one with the tag `parent`."""
        attributes = self._attributes(element, parent)
        written = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
        children = list(self._children(element, depth))
        self.lines.append(element)
        if not children and depth > 0:
            self.texts.append(f"<{element.tag}{written}/>")
            return
        self.texts.append(f"<{element.tag}{written}>")
        if depth == 0:
            # Static bodies and shapes without contact are kept, and no muscle is simulated to find its lengths.
            self._add('<compiler fusestatic="false" discardvisual="false"><lengthrange mode="none"/></compiler>')
        for child in children:
            self.write(child, element.tag, depth + 1)
        self._add(f"</{element.tag}>")

    def _add(self, text: str) -> None:
        self.texts.append(text)
        self.lines.append(None)

    def _children(self, element: Element, depth: int) -> Iterator[Element]:
        section = "" if depth == 0 else element.tag
        skipped = (*_LEFT_OUT.get(section, ()), *_LEFT_OUT_ANYWHERE)
        for child in element.children:
            if element.tag == "default" and child.tag != "plugin":
                yield child  # defaults for omitted elements do no harm
            elif child.tag in ("attach", "model") and element.tag in (*_BODIES, "asset"):
                raise child.error(
                    f"<{child.tag}> takes a part of another model file, which is not read; save the model as one file: "
                    "mujoco.MjSpec.from_file(...).to_xml()"
                )
            elif child.tag in _NOT_READ or (child.tag == "geom" and "hfield" in child.attributes):
                self.not_read.append("hfield" if child.tag == "geom" else child.tag)
            elif child.tag not in skipped:
                yield child

    def _attributes(self, element: Element, parent: str) -> dict[str, str]:
        for name, value in element.attributes.items():
            if not _WORDS.fullmatch(name):
                _check_finite(element, name, value)
        gone = _ATTRIBUTES_LEFT_OUT.get(element.tag, ())
        attributes = {name: value for name, value in element.attributes.items() if name not in gone}
        if element.tag == "key":
            attributes = {name: value for name, value in attributes.items() if name in _KEY_ATTRIBUTES}
        if element.tag == "mesh" and parent == "asset" and "file" in element.attributes:
            attributes["name"] = self._mesh_name(element)
        return attributes

    def _mesh_name(self, element: Element) -> str:
        """The name of a mesh asset; its file is recorded."""
        written = element.text("file").replace("\\", "/")
        name = element.attributes.get("name") or PurePosixPath(written).stem
        if name not in self.meshes:  # MuJoCo rejects duplicate names
            inside = PurePosixPath(written).name if self.strip_path else written
            folders = (self.file.parent, *self.lookup.packages)
            try:
                path = file_path(inside)
                places = [folder / file_path(self.mesh_folder or ".") / path for folder in folders]
                places += [folder / path for folder in folders[1:]]
            except InputError as error:
                raise element.error(f"a mesh's {error}") from error
            self.meshes[name] = MeshFile(element, written, tuple(places))
        return name


def _check_finite(element: Element, name: str, value: str) -> None:
    """Reject NaN and infinity, which MuJoCo accepts as numbers."""
    if "n" not in value.lower():
        return
    for word in value.split():
        try:
            number = float(word)
        except ValueError:
            return
        if not math.isfinite(number):
            raise element.error(f"<{element.tag}> {name}={value!r}, expected finite numbers")


def is_mjcf(file: Path) -> bool:
    """Whether a file that is named like XML contains MJCF.

    Raises:
        FormatError: the file cannot be read, or not as XML.
    """
    return is_regular(file) and root_tag(read_bytes(file, MAX_BYTES), file) in ("mujoco", "mujocoinclude")
