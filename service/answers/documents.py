"""Names for what has names of its own: JSON that others wrote, and rows by column. What has a known shape has a type instead."""

from typing import Any

JsonObject = dict[str, Any]
"""An object of JSON whose members are not ours to list: a foreign file, a stored document, a body before it is checked."""
RowValues = dict[str, Any]
"""Values of a table's row by column, as the ORM takes and gives them; the table says their types."""
