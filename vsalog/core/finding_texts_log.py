"""The texts of findings about a log as it was recorded: its files, clocks and tables, and the rig guessed for it."""

from __future__ import annotations

from collections.abc import Mapping

from vsalog.core.finding import Text

LOG_TEXTS: Mapping[str, Text] = {
    "recording.gaps": Text(
        "{value:.0f} gaps, {seconds:.3g} s in all.",
        "Nothing is estimated across those of more than {bridged:.0f} samples.",
    ),
    "recording.samples_lost": Text(
        "{part} lacks a sample or two at {value:n place}.", "They are bridged between the neighbours."
    ),
    "recording.outliers": Text(
        "{value:.0f} of {samples} samples of {part} are outliers, which no motion explains (first at {first:.6g} s).",
        "They are left out.",
    ),
    "recording.not_finite": Text(
        "{value:.0f} of {samples} samples of {part} are not finite numbers.",
        "They are left out, and bridged between the neighbours where one is alone.",
    ),
    "recording.clocks_apart": Text(
        "{stamped} is on header stamps and {other} on {clock} time, and in {stamped} the two are {value:.3g} s apart: they may"
        " be shifted by as much.",
        "--time log puts all on one clock.",
    ),
    "recording.downloaded": Text("downloaded to read it: {value:.1f} MiB."),
    "recording.truncated": Text(
        "the file ends within its data, as when a recording is cut off: read up to byte {value:.0f} of {limit:.0f}.",
        "The rest is left out.",
    ),
    "recording.bad_checksum": Text("the checksum of the data section does not match: some of its bytes have changed."),
    "recording.chunks_damaged": Text("{value:.0f} of {chunks:n chunk} damaged ({where}).", "The rest was read."),
    "recording.messages_lost": Text("with the damaged chunks {value:n message} lost at most.", "All others were read."),
    "recording.loss_unknown": Text("the index does not state how many messages the damaged chunks held."),
    "recording.bytes_skipped": Text("{value:n byte} between records damaged and skipped (at byte {where})."),
    "recording.unknown_records": Text("{value:n record} of an unknown kind skipped."),
    "recording.record_damaged": Text("a damaged channel, schema or metadata record was skipped."),
    "recording.definition_damaged": Text("{part}: its name, type or definition is damaged in one of its copies."),
    "recording.messages_missing": Text(
        "{value:.0f} of {expected:n message} that the {counted_by} counts were not found."
    ),
    "recording.chunks_missing": Text(
        "{value:.0f} of {chunks:n chunk} that the header counts were not found, nor their entries in the index."
    ),
    "recording.topics_incomplete": Text("messages are missing that the bag's metadata count: there are of {topics}."),
    "recording.messages_damaged": Text("{part}: {value:.0f} of {messages:n message} {misfit}.", "They were {done}."),
    "recording.no_index": Text(
        "the bag has no index (it was not closed properly).", "What is in it was found without."
    ),
    "recording.index_cut_off": Text(
        "the bag ends before its index, as when it is cut off.", "All that is in it was read."
    ),
    "recording.index_times_differ": Text("the log times of {value:n message} differ from those in the index."),
    "recording.no_summary": Text(
        "the file has no sound summary of its chunks at its end (was the recording cut off?)."
    ),
    "recording.joined": Text(
        "another log begins at byte {value:.0f} of {limit:.0f}, as where 'cat' joined them: it was not read.",
        "Cut the file there, and read both.",
    ),
    "recording.decompression_ended": Text(
        "decompression ended after {value:.0f} bytes ({reason}).", "The data before that were read."
    ),
    "recording.file_left_out": Text("{part} was left out: {reason}."),
    "recording.no_file_list": Text(
        "{part} is missing, cannot be read or names no files (was the recording cut off?): took {value:n file}, {files}."
    ),
    "recording.listed_files_absent": Text("{part} names files that are not there: took {value:n file} found instead."),
    "recording.files_missing": Text("{value:n file} of the bag missing, by {told_by}: {files}."),
    "recording.other_logs": Text("{part} holds other logs, which were left out: {logs}."),
    "recording.topic_damaged": Text(
        "topic {value:.0f} ({part}) has no name, type or encoding that can be read, as when the table of topics is damaged."
    ),
    "recording.unknown_topics": Text("{value:n message} of topics that the bag does not name skipped."),
    "recording.rows_without_message": Text("{value:n row} without a topic, a time or a message skipped."),
    "recording.database_damaged": Text("the database is damaged or was cut off.", "The readable part was read."),
    "recording.database_repeats": Text(
        "the database is damaged and refers to the same rows again and again: reading stopped."
    ),
    "recording.database_end_unreadable": Text(
        "the end of the database cannot be read (was it cut off?).", "The data before it were read."
    ),
    "recording.rows_unreadable": Text("{value:n row} of the database cannot be read.", "The rest was read."),
    "recording.row_numbers_missing": Text("{value:n row} of the database missing between others."),
    "recording.database_truncated": Text(
        "{value:.0f} of the database's {limit:.0f} bytes missing, as when the file was cut off.",
        "Messages may be lost; all that are there were read.",
    ),
    "recording.changes_damaged": Text(
        "{part} is damaged: {value:n page} after the damage, and messages with them, lost."
    ),
    "recording.changes_unreadable": Text(
        "the head of {part} is damaged: no change in it was read.", "Messages may be lost."
    ),
    "recording.publishers_apart": Text(
        "{part}: {value:.0f} {what} give the same values at the same time.", "Each is a stream of its own: {streams}."
    ),
    "recording.values_alternate": Text(
        "{part}: its values go back and forth from sample to sample, as when two publishers of different values share a topic.",
        "If so, none of its values can be attributed to one publisher.",
    ),
    "recording.copies_dropped": Text("{part}: {value:n exact copy} of samples dropped."),
    "recording.conflicts_dropped": Text(
        "{part}: {value:n sample} with the stamp of another but other values dropped.", "The first of each was kept."
    ),
    "recording.held_in_memory": Text(
        "{part}: samples come {value:.3g} s out of order; to sort them, this stretch was held in memory."
    ),
    "recording.too_long_for_memory": Text(
        "is too long for memory: its filters and scales, and whether its signals are plausible, were derived from stretches"
        " spread over it."
    ),
    "recording.variable_too_large": Text(
        "'{part}' of the MATLAB file is left out: {value:.0f} values, more than any recording of this size has."
    ),
    "recording.variables_damaged": Text(
        "{value:n variable} of the MATLAB file damaged and left out ({reason}).", "The rest was read."
    ),
    "recording.no_variables": Text("the MATLAB file holds no variables (was it cut off?)."),
    "recording.column_damaged": Text(
        "column '{part}' is damaged: {value:.0f} of its {rows:n row} are NaN, rows {begin} to {end} and {more:n more stretch}"
        " ({reason})."
    ),
    "recording.rows_left_out": Text(
        "column '{part}' is damaged: {value:.0f} of its {rows:n row} are left out, because nothing else gives their time or"
        " part,"
        " rows {begin} to {end} and {more:n more stretch} ({reason})."
    ),
    "recording.footer_damaged": Text(
        "the footer's metadata of the columns are damaged ({reason}) and not used.",
        "Units come from names only, there are no streams, and durations are plain numbers.",
    ),
    "recording.elements_left_out": Text(
        "column '{part}': only the first {value:.0f} of up to {limit:.0f} elements are read, as many as the first rows have."
    ),
    "compressed.bad_checksum": Text(
        "the checksum of the compressed file does not match: some of its bytes have changed, values may be wrong."
    ),
    "compressed.damaged": Text(
        "the compressed file is damaged ({reason}): read up to there, of which the last values may be wrong."
    ),
    "compressed.truncated": Text(
        "the compressed file is damaged or cut off ({reason}): read up to there.",
        "Its checksum is missing, so changed bytes before that cannot be detected.",
    ),
    "compressed.rows_left_out": Text(
        "the compressed file is damaged: left out from row {value:.0f} on, the first that does not fit; in the rows just before"
        " values may be wrong."
    ),
    "compressed.rows_doubtful": Text(
        "the compressed file is cut off, its checksum missing: left out from row {value:.0f} on, the first that does not fit,"
        " as where bytes have changed; in the rows just before values may be wrong.",
        "Decompress it first to read all rows.",
    ),
    "repair.attachment_damaged": Text("a damaged attachment left out."),
    "repair.unknown_channels": Text("{value:n message} of channels whose definition was lost left out."),
    "repair.no_time": Text("{part}: has no time, left out."),
    "clock.missing": Text("{part} has no time column.", "Give the sample rate with --rate, in Hz."),
    "clock.runs_backwards": Text("the time column '{part}' runs backwards at {where}, so there is no time."),
    "clock.rate_not_used": Text("the sample rate that was given is not used: the log has times of its own."),
    "clock.rows_without_time": Text("{part}: {value:n row} without a time left out."),
    "clock.beyond_reach": Text(
        "{value:n sample} left out whose times lie before the year 1823 or after 2116, as no recording's can."
    ),
    "clock.times_left_out": Text(
        "{part}: {value:n sample} left out, because of a time far from its neighbours, or from before the clock was set."
    ),
    "clock.stamps_left_out": Text(
        "{part}: {value:n sample} left out, because the header stamp is missing, zero, impossible or far from its neighbours.",
        "--time log keeps all samples.",
    ),
    "clock.out_of_order": Text("{part}: {value:n sample} came out of order.", "Sorted by time."),
    "clock.not_recorded": Text("{part} is on {used} time: it has no {asked} time."),
    "clock.log_stands": Text("{part} is on {used} time: the log's times are all the same."),
    "clock.stamps_all_same": Text(
        "{part} is on {used} time: its header stamps are all the same.", "--time header or log chooses."
    ),
    "clock.stamps_zero": Text(
        "{part} is on {used} time: {value:.0f} of its {stamps:n header stamp} zero.", "--time header or log chooses."
    ),
    "clock.stamps_far": Text(
        "{part} is on {used} time: {value:.0f} of its {stamps:n header stamp} more than a day off the log's times.",
        "--time header or log chooses.",
    ),
    "clock.many_stamps_far": Text(
        "{part} is on {used} time: more than one in {limit:.0f} of its header stamps are far from those around them.",
        "--time header or log chooses.",
    ),
    "clock.stamps_before_2000": Text(
        "{part} is on {used} time: its header stamps lie before the year 2000, unlike the log's times (a simulation's clock?).",
        "--time header or log chooses.",
    ),
    "clock.stamps_step": Text(
        "{part} is on {used} time: its header stamps step {way} by {value:.6g} s while the log's time goes on (a clock that was"
        " set?).",
        "--time header or log chooses.",
    ),
    "clock.restarts": Text("the time restarts {what} {value:n time}, without a new date.", "It is read as continuing."),
    "clock.log_appended": Text(
        "the time restarts {value:n time}, as in a log that was appended to another.",
        "What follows is placed after it, with a gap.",
    ),
    "clock.overflows": Text("the time's counter of 32 bits overflows {value:n time}.", "It is read as continuing."),
    "clock.guessed_by_dates": Text(
        "column '{part}' holds dates and times and is used as the time, because no other is named so."
    ),
    "clock.minutes_and_seconds": Text("times such as 59:58.5 are read as minutes and seconds."),
    "clock.dates_unreadable": Text(
        "the dates in column '{part}' cannot be read ({first}), so only the time of day is used.",
        "Dates such as 2026-01-31 can be read.",
    ),
    "clock.times_unreadable": Text(
        "the times in column '{part}' cannot be read ({first}).",
        "Write seconds, or dates such as 2026-01-31 12:00:00.5.",
    ),
    "clock.unit_unknown": Text(
        "column '{part}' is not used as the time: '{stated}' is none of the units s, ms, us, ns, min, h and d."
    ),
    "clock.date_order_by_time": Text(
        "dates such as '{example}' are read as {order}: the log's time runs forward then, and is shortest."
    ),
    "clock.date_order_unknown": Text(
        "dates such as '{example}' are read as {order}: the log does not determine which."
    ),
    "clock.guessed_by_rise": Text(
        "the first column, '{part}', is used as the time: it rises evenly, and no column is named so.",
        "Give the sample rate with --rate, in Hz, if it is something else.",
    ),
    "clock.perhaps": Text(
        "column '{part}' rises evenly.",
        "If it is the time, name it so in the header, with its unit: 'time [s]', 'time [ms]' or 'time [min]'.",
    ),
    "clock.counts_days": Text(
        "'{part}' is read as days since {since}, by its size and steps.", "Name it '{otherwise}' if it is in seconds."
    ),
    "clock.unit_by_steps": Text(
        "column '{part}' states no unit and is read as {read_as} because its steps are about {value:g}.",
        "Write the unit after its name if it is another one, such as '{otherwise}'.",
    ),
    "clock.unit_by_size": Text(
        "column '{part}' states no unit and is read as {read_as} since 1970 by its size, so that its samples are {value:.3g} s"
        " apart.",
        "Name it '{otherwise}' if it counts {finer} from some start.",
    ),
    "clock.perhaps_since_1904": Text(
        "column '{part}' is read as seconds since 1970, and is far in the future then: LabVIEW counts from 1904, {value:.0f}"
        " seconds earlier.",
        "Times within the log do not depend on it.",
    ),
    "clock.not_rising": Text("'{part}' is not used as the time: its value {value:.0f} is not above the one before."),
    "clock.no_times": Text("'{part}' is not used as the time: its values are not times."),
    "table.no_header": Text("the table has no header: its columns are called column_0, column_1, …"),
    "table.rows_ahead_of_header": Text("{value:n row} of values before the header left out."),
    "table.words_below_header": Text("a second row of words below the names skipped: '{cells}'."),
    "table.unnamed_column": Text(
        "the header has one name fewer than the rows have cells: the first column is taken as unnamed."
    ),
    "table.header_again": Text("{value:n line} between the rows skipped as repeated headers."),
    "table.other_table": Text(
        "left out from row {value:.0f} on: a header there ('{header}') names other columns than the first, or other units.",
        "Put what follows it into a file of its own.",
    ),
    "table.remarks": Text("{value:n line} between the rows skipped as comments (they begin with # or %)."),
    "table.lines_skipped": Text("{value:n line} without exactly {cells} cells skipped (the first: '{first}')."),
    "table.stray_quotes": Text("{value:n row} skipped that a stray quote joins with the rows after it."),
    "table.last_line_left_out": Text(
        "the last line is left out: it has no line end, and its last number may be cut off ('{line}')."
    ),
    "table.decimal_commas": Text("the comma in numbers is read as a decimal mark."),
    "table.numbers_rounded": Text("column '{part}': its whole numbers are rounded to 53 bits, such as {number}."),
    "table.cells_without_number": Text(
        "column '{part}': {value:n cell} without a number read as NaN (the first in row {row}: '{first}')."
    ),
    "table.columns_apart": Text(
        "{value:n group} of columns with many blank cells read without them, as streams of their own."
    ),
    "table.several_clocks": Text(
        "the time has {value:n column}: each is that of the columns next to it, up to the next."
    ),
    "table.long": Text(
        "{part}: names what the values of a row belong to; a stream for each of {value:.0f} values ({names})."
    ),
    "table.others_left_out": Text(
        "{part}: {value:n row} left out that hold the values of others than the first {limit:.0f}."
    ),
    "table.names_move": Text(
        "the names in column '{part}' and the next change places in {value:n row}: values go with their names, {shown}"
        " throughout."
    ),
    "table.names_unknown": Text(
        "{value:n cell} of names next to which values are left out, as the first row has no such name (the first: '{first}')."
    ),
    "rig.guessed": Text(
        "no rig was found in or next to it, so the roles are guessed. {roles}.",
        "'vsalog init {name:q} -o {rig:q}' writes them down for you to check and correct.",
    ),
    "rig.joint_left_out": Text("left out: {reason}."),
    "guess.no_position": Text("{channels}: no position next to it, so it was assigned to no joint."),
    "guess.streams_without_time": Text("{streams}: no time column, skipped."),
    "guess.runs_left_out": Text("{streams}: named differently from the runs '{part}', left out."),
    "guess.gear_ratio_bounded": Text(
        "motor and link move as by a gear ratio of {value:.4g} ({low:.4g} to {high:.4g}, 95 %).",
        "Look the ratio up, and write it as gear_ratio: an error in it looks like a deflection.",
    ),
    "guess.gear_ratio": Text(
        "motor and link move as by a gear ratio of about {value:.2g}; the log has nothing in proportion to the deflection, which"
        " moves the link too, so this has no interval.",
        "Look the ratio up, and write it as gear_ratio: an error in it looks like a deflection.",
    ),
    "guess.two_motors": Text(
        'two motors may be antagonists, or a main motor and one that sets the stiffness (then kind = "serial").'
    ),
    "guess.no_torque": Text(
        "there is no torque and no motor current, so no stiffness can be estimated from this log alone."
    ),
    "guess.raw_counts": Text(
        "'{part}' is in raw counts, by its unit or its whole numbers.",
        "counts_per_turn in the rig says how many make a turn.",
    ),
}
