"""Logs → recordings. The format is detected from the content, never from the file name."""

from vsalog.readers.base import Block, Catalogue, ChannelInfo, Reader
from vsalog.readers.reading import open_container, open_reader, read

__all__ = ["Block", "Catalogue", "ChannelInfo", "Reader", "open_container", "open_reader", "read"]
