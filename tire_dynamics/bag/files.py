"""Which files a bag consists of, and what each of them is."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import yaml

from ..files.errors import InputError, missing
from .compression import ZSTD_MAGIC, CompressionError, ZstdStream
from .record_types import MAGIC

__all__ = ["MCAP", "ROS1", "SQLITE", "Found", "Unpacking", "absent", "files_of", "kind_of", "yaml_texts"]

MCAP, SQLITE, ROS1, ZSTD, LFS, EMPTY, OTHER = "mcap", "sqlite3", "ROS 1", "zstd", "lfs", "empty", ""

_BEGINS = {
    MAGIC: MCAP,
    b"SQLite format 3\0": SQLITE,
    b"#ROSBAG V": ROS1,
    ZSTD_MAGIC: ZSTD,
    b"version https://git-lfs.github.com/spec/": LFS,
}
_LONGEST_BEGIN = max(map(len, _BEGINS))
_MAX_METADATA_YAML = 2 * 2**20  # bytes; 300 topics take a tenth
_MAX_DEPTH = 30  # of metadata.yaml; rosbag2's is 6
_PIECE = 2**12  # bytes that are unpacked together: at most 128 MiB
_LARGE, _MAX_RATIO = 2**30, 1000  # no recording of more than so many bytes is compressed so well


class Found(NamedTuple):
    """A file of a bag: its name, where its bytes are (unpacked, perhaps), what it is, and what is wrong with it."""

    path: Path
    place: Path
    kind: str
    damage: str


def kind_of(path: Path) -> str:
    """What a file is by its first bytes; ``InputError`` if it cannot be read, is empty or still in Git LFS."""
    if not path.is_file():
        raise InputError(f"{path}: is not a file")
    try:
        with open(path, "rb") as file:
            begin = file.read(_LONGEST_BEGIN)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not begin:
        raise InputError(f"{path}: is empty; its recorder wrote nothing")
    kind = next((kind for first, kind in _BEGINS.items() if begin.startswith(first)), OTHER)
    if kind == LFS:
        raise InputError(f"{path}: is a pointer of Git LFS, not the file itself; git lfs pull fetches it")
    return kind


class Unpacking:
    """Files as they can be read: what was compressed as a whole (``.zstd``) is unpacked into a folder for a while.

    The folder goes with this object.
    """

    def __init__(self) -> None:
        self._folder: Path | None = None

    def find(self, path: Path) -> Found:
        """A file of a bag.

        Raises
        ------
        InputError
            It is not a file of a bag, or cannot be read or unpacked.
        """
        kind = kind_of(path)
        if kind != ZSTD:
            found = Found(path, path, kind, "")
        else:
            if self._folder is None:
                self._folder = Path(tempfile.mkdtemp(prefix="tire_dynamics_"))
                weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
            place = self._folder / (path.name.removesuffix(".zstd").removesuffix(".zst") or "bag")
            damage = _unpack(path, place)
            if not place.stat().st_size:
                raise InputError(f"{path}: cannot be unpacked: {damage or 'there is nothing in it'}")
            found = Found(path, place, kind_of(place), damage)
        if found.kind in (OTHER, ZSTD):
            raise InputError(f"{path}: is not an MCAP file; a rosbag2 folder, or a .mcap, .db3 or .bag file is wanted")
        return found


def _unpack(path: Path, place: Path) -> str:
    """Undo a file's compression as far as it goes; what is wrong with it."""
    most = max(_LARGE, _MAX_RATIO * path.stat().st_size)
    whole = True
    try:
        with open(path, "rb") as file, open(place, "wb") as unpacked:
            frame = ZstdStream()
            while piece := file.read(_PIECE):
                while piece:
                    if whole and unpacked.tell():  # one frame after the other
                        frame = ZstdStream()
                    unpacked.write(frame.decompress(piece))
                    whole = frame.eof
                    piece = frame.unused_data if whole else b""
                if unpacked.tell() > most:
                    raise InputError(f"{path}: claims to hold more than {_MAX_RATIO} times its size")
    except CompressionError as error:
        return f"its compression is damaged: {' '.join(str(error).split())}"
    except OSError as error:
        raise InputError(f"{path}: cannot be unpacked into {place.parent}: {error.strerror}") from None
    return "" if whole else "it ends in the middle of its compression"


def files_of(path: Path) -> list[Path]:
    """The bag's files, in order: those that ``metadata.yaml`` lists, or the one that is named.

    Raises
    ------
    InputError
        There is no bag, or it is not one that can be read.
    """
    if not path.exists():
        raise missing(path)
    if not path.is_dir():
        return [path]
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        raise InputError(f"{path}: has no metadata.yaml; {_instead(path)}")
    try:
        if metadata.stat().st_size:
            kind_of(metadata)
        if metadata.stat().st_size > _MAX_METADATA_YAML:
            raise InputError(f"{metadata}: too large to be the description of a bag")
        information = yaml_texts(metadata.read_bytes())["rosbag2_bagfile_information"]
        storage = information["storage_identifier"]
        mode, how = (information.get(f"compression_{name}") or "none" for name in ("mode", "format"))
        names = information["relative_file_paths"]
        if not isinstance(names, list) or not all(isinstance(text, str) for text in (storage, mode, how, *names)):
            raise ValueError
    except OSError as error:
        raise InputError(f"{metadata}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise InputError(f"{metadata}: is not the description of a bag") from None
    if storage not in (MCAP, SQLITE, ""):  # "": the files say what they are
        raise InputError(
            f"{path}: its storage is {storage!r}; mcap and sqlite3 are read; ros2 bag convert makes such a bag of it, "
            "where the plugin of that storage is installed"
        )
    mode = mode.lower()
    if mode not in ("none", "null", "~", "file", "message", "storage"):
        raise InputError(f"{path}: its compression_mode is {mode!r}; file, message or storage is read")
    if mode in ("file", "message") and how.lower() != "zstd":
        raise InputError(f"{path}: its compression_format is {how!r}; zstd is read")
    if not names or len(set(names)) < len(names):
        raise InputError(f"{metadata}: lists {'a file twice' if names else 'no file'}")
    return [_file_of(path, name) for name in names]


def absent(folder: Path) -> list[str]:
    """The files that a folder's ``metadata.yaml`` lists and that are not there; none if it cannot be read."""
    try:
        text = (folder / "metadata.yaml").read_bytes()[: _MAX_METADATA_YAML + 1]
        names = yaml_texts(text)["rosbag2_bagfile_information"]["relative_file_paths"]
        listed = names if isinstance(names, list) else []
        pure = dict.fromkeys(PurePath(name).name for name in listed if isinstance(name, str))
    except (OSError, yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        return []
    return [name for name in pure if name and not any((folder / f"{name}{end}").exists() for end in ("", ".zstd"))]


def _file_of(folder: Path, name: str) -> Path:
    """A file that ``metadata.yaml`` lists; the first versions of rosbag2 put the folder's name before it."""
    pure = PurePath(name)
    if pure.name != name and (len(pure.parts) != 2 or ".." in pure.parts or pure.is_absolute()):
        raise InputError(f"{folder / 'metadata.yaml'}: {name!r} is not a file of this folder")
    for file in (folder / pure.name, folder / f"{pure.name}.zstd"):  # compressed since
        if file.exists():
            return file
    if pure.name != name:
        raise InputError(f"{folder / 'metadata.yaml'}: {name!r} is not a file of this folder")
    raise InputError(
        f"{folder / name}: does not exist, though metadata.yaml lists it; tire-dynamics recover makes a bag of "
        "the files that do"
    )


def _instead(folder: Path) -> str:
    """What to name in place of a folder that is no bag."""
    endings = (".db3", ".bag", ".db3.zstd")
    try:
        found = sorted(name for name in os.listdir(folder) if name.endswith(endings))
    except OSError:
        found = []
    if found:
        return f"name the file instead: {folder / found[0]}"
    return "of a recording that was cut off, name the .mcap file, or make it whole with tire-dynamics recover"


def yaml_texts(text: bytes) -> Any:
    """YAML with every plain value a text: no tag means anything, no key is merged, no number is made.

    An alias stands for the same object, so that its size is that of the file; to print it may take forever.
    """
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    depth = 0
    for event in yaml.parse(text, Loader=loader):  # first: nesting too deep ends a process in libyaml's composer
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            raise ValueError("nested too deep")
    return yaml.load(text, Loader=loader)
