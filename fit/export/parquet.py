"""Export of tables as Parquet: numbers as doubles, null for missing values, provenance in the file's metadata."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence

from fit.export.about import provenance
from formats.fit_records import FitResult


def parquet(heads: Sequence[str], rows: Iterable[Sequence[object]], result: FitResult) -> bytes:
    """Return a table as Parquet; a column with any text is a text column.

    Raises:
        ModuleNotFoundError: PyArrow is not installed.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = list(zip(*rows, strict=True))
    arrays = []
    for values in columns:
        is_text = any(isinstance(v, str) for v in values)
        cells = [None if v is None else str(v) if is_text else float(v) for v in values]
        arrays.append(pa.array(cells, pa.string() if is_text else pa.float64()))
    table = pa.table(dict(zip(heads, arrays, strict=True)))
    table = table.replace_schema_metadata({"hangtime": json.dumps(provenance(result))})
    stream = io.BytesIO()
    pq.write_table(table, stream, compression="zstd")
    return stream.getvalue()
