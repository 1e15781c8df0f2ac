"""Simulate power cuts: record a process' file operations, and generate every state that a power cut may leave.

The shim replaces the calls of `os` that change names or sync content. The model keeps only what `man 2 fsync`
guarantees. It may lose content that was not synced, and names of a folder that was not synced after their change.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Inode:
    """A file's content, as the process sees it and as the disk has it."""

    seen: bytes = b""
    synced: bytes = b""


@dataclass
class State:
    """The disk after some call.

    folders: every folder that was made; whether it is there after a cut depends on its parent's names
    names, synced_names: path to inode, as the process sees it and as the disk has it
    pending: changes of names since their folder was synced, in order: folder, path, inode or None
    """

    folders: set[str] = field(default_factory=set)
    inodes: dict[int, Inode] = field(default_factory=dict)
    names: dict[str, int] = field(default_factory=dict)
    synced_names: dict[str, int] = field(default_factory=dict)
    pending: list[tuple[str, dict[str, int | None]]] = field(default_factory=list)

    def copy(self) -> State:
        inodes = {number: Inode(one.seen, one.synced) for number, one in self.inodes.items()}
        return State(set(self.folders), inodes, dict(self.names), dict(self.synced_names), list(self.pending))


@dataclass(frozen=True)
class Moment:
    """The disk after a call; `promises`: number of promises made by then, `beside`: content of another machine."""

    call: str
    state: State
    promises: int
    beside: dict[str, bytes]

    def cuts(self) -> Iterator[tuple[str, dict[str, bytes]]]:
        """Yield every state of files that a power cut at this moment may leave, with its description."""
        seen = set()
        for kept in range(len(self.state.pending) + 1):
            names: dict[str, int] = dict(self.state.synced_names)
            for _, change in self.state.pending[:kept]:
                for path, number in change.items():
                    if number is None:
                        names.pop(path, None)
                    else:
                        names[path] = number
            for word in ("synced content", "torn content", "all content"):
                files = {path: self._content(self.state.inodes[number], word) for path, number in names.items()}
                key = tuple(sorted(files.items()))
                if key not in seen:
                    seen.add(key)
                    yield f"{self.call}, {kept} unsynced names, {word}", files

    @staticmethod
    def _content(inode: Inode, word: str) -> bytes:
        if word == "synced content":
            return inode.synced
        if word == "torn content":
            return inode.seen[: (len(inode.synced) + len(inode.seen)) // 2]
        return inode.seen


class Disk:
    """Records file operations below a folder; `beside` is a folder of another machine, which keeps its power."""

    def __init__(self, root: Path, beside: Path | None = None) -> None:
        self.root, self._beside = str(root), beside
        self.moments: list[Moment] = []
        self.promises: list[object] = []
        self.state = State()
        self._next = 0
        for path in sorted(root.rglob("*")):
            if path.is_file():
                content = path.read_bytes()
                self._next += 1
                self.state.inodes[self._next] = Inode(content, content)
                self.state.names[str(path)] = self.state.synced_names[str(path)] = self._next

    def promise(self, what: object) -> None:
        """Record a promise that the product has made to its user."""
        self.promises.append(what)
        self._note("promise")

    @contextmanager
    def recording(self, monkeypatch):
        real = {name: getattr(os, name) for name in ("open", "fsync", "replace", "rename", "unlink", "remove", "mkdir")}

        def opened(path, flags, *rest, **named):
            place = os.path.abspath(os.fspath(path))
            is_new = bool(flags & os.O_CREAT) and not os.path.exists(place)
            handle = real["open"](path, flags, *rest, **named)
            if is_new and self._is_ours(place):
                self._next += 1
                self.state.inodes[self._next] = Inode()
                self._change({place: self._next}, f"create {os.path.basename(place)}")
            return handle

        def synced(handle):
            real["fsync"](handle)
            place = os.readlink(f"/proc/self/fd/{handle}")
            if not self._is_ours(place):
                return
            self._look()
            if os.path.isdir(place):
                ours = [change for folder, change in self.state.pending if folder == place]
                self.state.pending = [(folder, change) for folder, change in self.state.pending if folder != place]
                for change in ours:
                    for path, number in change.items():
                        if number is None:
                            self.state.synced_names.pop(path, None)
                        else:
                            self.state.synced_names[path] = number
            else:
                inode = self.state.inodes[self.state.names[place]]
                inode.synced = inode.seen
            self._note(f"fsync {os.path.basename(place)}")

        def renamed(source, target, **named):
            self._look()
            a, b = os.path.abspath(os.fspath(source)), os.path.abspath(os.fspath(target))
            real["replace"](source, target, **named)
            if self._is_ours(a):
                assert os.path.dirname(a) == os.path.dirname(b), "only renames within one folder are all or nothing"
                self._change({b: self.state.names[a], a: None}, f"rename to {os.path.basename(b)}")

        def removed(path, **named):
            self._look()
            place = os.path.abspath(os.fspath(path))
            real["unlink"](path, **named)
            if self._is_ours(place):
                self._change({place: None}, f"unlink {os.path.basename(place)}")

        def made(path, *rest, **named):
            real["mkdir"](path, *rest, **named)
            self._note(f"mkdir {os.path.basename(os.fspath(path))}")

        with monkeypatch.context() as patch:
            for name, stand_in in (
                ("open", opened), ("fsync", synced), ("replace", renamed), ("rename", renamed), ("unlink", removed),
                ("remove", removed), ("mkdir", made),
            ):  # fmt: skip
                patch.setattr(os, name, stand_in)
            yield self

    def lay(self, files: dict[str, bytes], place: Path) -> Path:
        """Create a folder with this disk's state after a cut."""
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        for path, content in files.items():
            target = place / os.path.relpath(path, self.root)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
        return place

    def _is_ours(self, place: str) -> bool:
        return place == self.root or place.startswith(self.root + os.sep)

    def _look(self) -> None:
        """Record the bytes written since the last call."""
        for path, number in self.state.names.items():
            with open(path, "rb") as file:
                self.state.inodes[number].seen = file.read()

    def _change(self, change: dict[str, int | None], call: str) -> None:
        for path, number in change.items():
            if number is None:
                self.state.names.pop(path, None)
            else:
                self.state.names[path] = number
        self.state.pending.append((os.path.dirname(next(iter(change))), change))
        self._look()
        self._note(call)

    def _note(self, call: str) -> None:
        self._look()
        self.moments.append(Moment(call, self.state.copy(), len(self.promises), self._held_beside()))

    def _held_beside(self) -> dict[str, bytes]:
        if self._beside is None:
            return {}
        return {
            str(path.relative_to(self._beside)): path.read_bytes() for path in self._beside.rglob("*") if path.is_file()
        }
