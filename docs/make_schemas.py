"""Write the schemas of `diagnosis.json` and `report.json` into docs: ``python -m docs.make_schemas``."""

from pathlib import Path

from vsalog.core.document_schema import schema_text
from vsalog.diagnosis import document as diagnosis
from vsalog.validation import document as report

HERE = Path(__file__).parent


def main() -> None:
    """Write both."""
    for name, module in (("diagnosis", diagnosis), ("report", report)):
        (HERE / f"{name}.schema.json").write_text(schema_text(module), encoding="utf-8")


if __name__ == "__main__":
    main()
