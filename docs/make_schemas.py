"""Write the schemas of the documents that commands give into docs: ``python -m docs.make_schemas``."""

from pathlib import Path

from vsalog.core.document_schema import schema_text
from vsalog.diagnosis import document as diagnosis
from vsalog.diagnosis import plan_document as plan
from vsalog.identification import document as identification
from vsalog.validation import document as report

HERE = Path(__file__).parent


def main() -> None:
    """Write them."""
    documents = {"diagnosis": diagnosis, "identification": identification, "plan": plan, "report": report}
    for name, module in documents.items():
        (HERE / f"{name}.schema.json").write_text(schema_text(module), encoding="utf-8")


if __name__ == "__main__":
    main()
