"""What the fold carries after some of a pump's records, so that the next fold need not begin at the first."""

from datetime import datetime

from sqlalchemy import ForeignKey, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base


class FoldSnapshot(Base):
    """One snapshot of ``detectors.judgement.snapshot``, taken after the pump's first ``records`` records.

    ``chain`` names everything that it was folded from (``service.monitoring.chain``): where the pump's history has
    another link at that place the snapshot is worthless, and nobody needs to say so. ``since`` is the verdict's.
    """

    __tablename__ = "fold_snapshots"
    __table_args__ = (UniqueConstraint("pump_id", "records"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"))
    records: Mapped[int]
    chain: Mapped[str]
    since: Mapped[datetime | None]
    content: Mapped[bytes]
