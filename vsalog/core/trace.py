"""An estimator's output over time, and its layout as an Arrow table."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.arrow import arrow_column, arrow_texts, data_frame
from vsalog.core.signals import JointSignals

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]

# Columns every estimator gives, with their units, in the order they are written.
UNITS = {
    "deflection": "rad",
    "flexibility_torque": "N*m",
    "flexibility_torque_fit": "N*m",
    "stiffness": "N*m/rad",
    "stiffness_std": "N*m/rad",
    "excited": "",
    "stiffness_derivative": "N*m/rad^2",
    "stiffness_second_derivative": "N*m/rad^3",
}
EXTRA_UNITS = {
    "residual": "N*m",
    "residual_fit": "N*m",
    "stability_factor": "",
    "setpoint": "rad or m",
    "link_position": "rad",
    "link_position_std": "rad",
    "link_velocity": "rad/s",
    "link_velocity_std": "rad/s",
    "link_acceleration": "rad/s^2",
    "link_acceleration_std": "rad/s^2",
    "motor_position": "rad",
    "motor_position_std": "rad",
    "motor_velocity": "rad/s",
    "motor_velocity_std": "rad/s",
    "deflection_std": "rad",
    "pressure_1": "Pa",
    "pressure_1_std": "Pa",
    "pressure_2": "Pa",
    "pressure_2_std": "Pa",
    "flexibility_torque_std": "N*m",
    "external_stiffness": "N*m/rad",
    "external_stiffness_std": "N*m/rad",
    "link_inertia": "kg*m^2",
    "link_inertia_std": "kg*m^2",
    "link_damping": "N*m*s/rad",
    "link_damping_std": "N*m*s/rad",
    "motor_inertia": "kg*m^2",
    "motor_inertia_std": "kg*m^2",
    "motor_damping": "N*m*s/rad",
    "motor_damping_std": "N*m*s/rad",
}


@dataclass(frozen=True, slots=True)
class Trace:
    """Estimates of one joint, or a block of them.

    Attributes
    ----------
    joint : the joint's name
    stamps : shape (N,), int64 ns as in the log
    time : shape (N,), seconds from the start of the log
    run : shape (N,), index into `run_names`
    run_names : names of the runs
    transmissions : per transmission ("1", "2", and "total" for the device) the columns, each of shape (N,)
    """

    joint: str
    stamps: NDArray[np.int64]
    time: Array
    run: NDArray[np.int32]
    run_names: tuple[str, ...]
    transmissions: Mapping[str, Mapping[str, NDArray[np.generic]]]

    def __len__(self) -> int:
        return int(self.time.shape[0])

    def __getitem__(self, transmission: str) -> Mapping[str, NDArray[np.generic]]:
        return self.transmissions[transmission]

    def never_excited(self, transmissions: Collection[str]) -> Trace:
        """Return the trace with no sample of some transmissions excited."""
        never = {"excited": np.zeros(len(self), np.bool_)}
        columns = {name: {**own, **never} if name in transmissions else own for name, own in self.transmissions.items()}
        return replace(self, transmissions=columns)

    @classmethod
    def of_rows(cls, rows: JointSignals, transmissions: Mapping[str, Mapping[str, NDArray[np.generic]]]) -> Trace:
        """Add the estimates to the rows of a filtered block."""
        return cls(rows.joint, rows.stamps, rows.time, rows.run, rows.run_names, transmissions)

    @classmethod
    def concatenate(cls, blocks: Sequence[Trace]) -> Trace:
        """Join blocks of one joint in the order given."""
        first = blocks[0]
        return cls(
            first.joint,
            np.concatenate([b.stamps for b in blocks]),
            np.concatenate([b.time for b in blocks]),
            np.concatenate([b.run for b in blocks]),
            first.run_names,
            {
                name: {column: np.concatenate([b[name][column] for b in blocks]) for column in columns}
                for name, columns in first.transmissions.items()
            },
        )

    def to_table(self) -> pa.Table:
        """Return the trace as an Arrow table in the layout of the Parquet file."""
        return pa.concat_tables(trace_tables(self), promote_options="default")

    def to_pandas(self) -> pandas.DataFrame:
        """Return the trace as a data frame.

        Raises
        ------
        VsalogError
            pandas is not installed.
        """
        return data_frame(self.to_table())


def _unit(column: str) -> str:
    if column.startswith("coefficient_"):
        return "N*m"
    return UNITS.get(column, EXTRA_UNITS.get(column, ""))


def _field(name: str, kind: pa.DataType, unit: str = "") -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


def trace_schema(columns: list[str], metadata: Mapping[str, str] | None = None) -> pa.Schema:
    """Return the schema of a trace with these columns; those every estimator gives come first."""
    text = pa.dictionary(pa.int32(), pa.string())
    fields = [
        _field("time", pa.float64(), "s"),
        _field("stamp", pa.int64(), "ns"),
        _field("joint", text),
        _field("transmission", text),
        _field("run", text),
    ]
    fields += [
        _field(name, pa.bool_() if name == "excited" else pa.float64(), _unit(name))
        for name in [*UNITS, *(c for c in columns if c not in UNITS)]
    ]
    return pa.schema(fields, metadata=dict(metadata) if metadata else None)


def trace_columns(trace: Trace) -> list[str]:
    """Return the names of all columns that any transmission of a trace has, in order."""
    return list(dict.fromkeys(name for columns in trace.transmissions.values() for name in columns))


def trace_tables(trace: Trace, schema: pa.Schema | None = None) -> Iterator[pa.Table]:
    """Turn a trace, or a block of one, into a table per transmission; columns a transmission lacks are null."""
    schema = schema or trace_schema(trace_columns(trace))
    runs = pa.DictionaryArray.from_arrays(arrow_column(trace.run.astype(np.int32)), arrow_texts(trace.run_names))
    for name, columns in trace.transmissions.items():
        fixed = {
            "time": arrow_column(trace.time),
            "stamp": arrow_column(trace.stamps),
            "joint": _constant(trace.joint, len(trace)),
            "transmission": _constant(name, len(trace)),
            "run": runs,
        }
        arrays = [
            fixed[field.name]
            if field.name in fixed
            else arrow_column(columns[field.name])
            if field.name in columns
            else pa.nulls(len(trace), field.type)
            for field in schema
        ]
        yield pa.Table.from_arrays(arrays, schema=schema)


def _constant(text: str, length: int) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(arrow_column(np.zeros(length, np.int32)), arrow_texts([text]))
