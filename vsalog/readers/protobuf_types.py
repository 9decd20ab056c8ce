"""Protobuf descriptors in a log → message classes.

A log's types are untrusted data: their size is limited, and the library checks them.
"""

from __future__ import annotations

from typing import Any

from vsalog.core.memory import PIECE_BYTES
from vsalog.core.printable import printable
from vsalog.readers.message_definitions import DefinitionError


def message_class(name: str, descriptors: bytes) -> Any:
    """Return the class of a message type.

    Parameters
    ----------
    name : str
        Full name of the type, ``foxglove.PoseInFrame``.
    descriptors : bytes
        A serialised ``FileDescriptorSet`` that has it and all it imports.

    Raises
    ------
    DefinitionError
        The package ``protobuf`` is not installed, or the descriptors are damaged, too long or not complete.
    """
    try:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
        from google.protobuf.message import DecodeError
    except ImportError:
        raise DefinitionError(
            "its messages are protobuf, for which the package of that name is needed: pip install 'vsalog[protobuf]'"
        ) from None
    shown = printable(name[:200])
    if len(descriptors) > PIECE_BYTES:
        raise DefinitionError(f"the descriptors of {shown} have {len(descriptors)} bytes; larger ones are not read")
    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(descriptors).file
    except DecodeError as error:
        raise DefinitionError(f"the descriptors of {shown} are damaged") from error
    pool = descriptor_pool.DescriptorPool()
    try:
        for file in _importing_last({file.name: file for file in files}):
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    except Exception as error:  # whatever foreign descriptors provoke in the library
        words = printable(" ".join(str(error).split())[:200])
        raise DefinitionError(f"the descriptors of {shown} are not complete or not sound ({words})") from error


def _importing_last(files: dict[str, Any]) -> list[Any]:
    """Return files after those that they import; the library's own files, which all may import, come first."""
    files = {**_library_files(files), **files}
    ordered: dict[str, Any] = {}
    waiting = list(files)
    while waiting:
        ready = [name for name in waiting if all(one in ordered or one not in files for one in files[name].dependency)]
        if not ready:
            break  # they import one another: the pool refuses the rest
        ordered.update((name, files[name]) for name in ready)
        waiting = [name for name in waiting if name not in ordered]
    return [*ordered.values(), *(files[name] for name in waiting)]


def _library_files(files: dict[str, Any]) -> dict[str, Any]:
    """Return files that the library brings along, where they are imported but left out of the log."""
    from google.protobuf import descriptor_pb2, duration_pb2, timestamp_pb2, wrappers_pb2

    imported = {name for file in files.values() for name in file.dependency}
    found = {}
    for module in (duration_pb2, timestamp_pb2, wrappers_pb2):
        if module.DESCRIPTOR.name in imported:
            file = descriptor_pb2.FileDescriptorProto()
            module.DESCRIPTOR.CopyToProto(file)
            found[file.name] = file
    return found
