"""What an installation keeps for itself, whoever its operators are."""

from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base


class InstallationValue(Base):
    """One value by its name; all replicas on one database share it."""

    __tablename__ = "installation_values"

    name: Mapped[str] = mapped_column(primary_key=True)
    value: Mapped[str]
