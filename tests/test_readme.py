"""The README's five lines, run as a script: they print the page's address and wait for a viewer."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
import urllib.request
from pathlib import Path

from tornado.websocket import websocket_connect

README = Path(__file__).parent.parent / "README.md"


# Three seconds: a new process plans, and a page has to be gone for a while before it counts as closed.
def test_the_five_lines_serve_their_page_until_it_is_closed(tmp_path: Path) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.MULTILINE | re.DOTALL)
    (tmp_path / "five.py").write_text(code)
    command = [sys.executable, "-W", "error", "five.py"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as script:
        try:
            assert script.stdout is not None
            lines = []
            for line in script.stdout:
                lines.append(line)
                if line.startswith("page: "):
                    break
            url = lines[-1].removeprefix("page: ").strip()
            assert script.poll() is None
            with urllib.request.urlopen(url, timeout=20) as answer:
                page = answer.read().decode()
            assert "MeshCat" in page
            asyncio.run(_open_and_close(url, re.search('"token":"(.+?)"', page)[1]))
            _, errors = script.communicate(timeout=60)
        finally:
            script.kill()
    assert script.returncode == 0
    assert errors == ""
    assert "certified free of collision in continuous time" in "".join(lines)


async def _open_and_close(url: str, token: str) -> None:
    connection = await websocket_connect(f"{url.replace('http', 'ws')}updates?version=0&token={token}")
    assert await connection.read_message() is not None
    connection.close()
    while await connection.read_message() is not None:
        pass
