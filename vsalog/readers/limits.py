"""Limits of reading that several readers share."""

GLANCE_BYTES = 2**16
"""Bytes of the beginning or end of a file, chunk, record or line that are read: no header, name or row is as long."""

PACKED_BYTES = 16 * 2**20
"""Bytes of messages that come one by one, until they make a packet or a block; or `BLOCK_ROWS` of them. A smaller unpacked
size is no decompression bomb, and a longer line has no end."""

DECODED_BYTES = 4 * 2**20
"""Bytes of text (rows of a table, a JSON message, definitions) that become objects at once: two may become one of fifty."""

MOST_WAITING = 2**22
"""Samples of a stream that wait for late ones before it is sorted as a whole."""

BLOCK_ROWS = 8192
"""Samples a block has at most: large enough for NumPy, small enough that a log is never in memory as a whole."""

MAX_ARRAY = 64
"""Elements of an array, or names in a column, that are parts of a machine; more are images, clouds, maps or counters."""

MOST_PARTS = 256
"""Parts of a stream or table (devices, frames, patterns of blanks), or layouts of messages of one length, that are separated;
more are a counter's values."""

MOST_STEPS = 2**18
"""Parts of a message, characters of its definition, or records of a file that Python walks one by one, in a second or so."""

SAMPLE_ROWS = 256
"""Rows of a table, chunks of a log or samples of a stretch that are read as representative of all."""

FIRST_ROWS = 32
"""Lines of a header, rows of values ahead of it, messages of a connection, rows of a database that a beginning has at most."""

MOST_EXCEPTIONS = 0.1
"""Part of the rows, stamps or messages that may violate a rule; with more, the rule is rejected."""

MOST_DAMAGED = 1e-3
"""Part of the bytes or messages that may be damaged names or texts; with more, they are the file's real content."""

TIMES_LARGER = 5
"""Factor over the usual size at which a step, an interval or a stamp's error counts as an outlier."""

SHOWN = 3
"""Names or places that a finding lists; of more it reports the number."""
