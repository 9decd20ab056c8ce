"""Write the schemas of the documents that commands give into docs: ``python -m docs.make_schemas``."""

from pathlib import Path

from vsalog.core.document_schema import schema_text
from vsalog.diagnosis import document as diagnosis
from vsalog.identification import document as identification
from vsalog.validation import document as report

HERE = Path(__file__).parent


def main() -> None:
    """Write them."""
    for name, module in (("diagnosis", diagnosis), ("identification", identification), ("report", report)):
        (HERE / f"{name}.schema.json").write_text(schema_text(module), encoding="utf-8")


if __name__ == "__main__":
    main()
