"""Commands of administrators: keys, users, the database."""

from datetime import datetime
from typing import Annotated

import typer

from service.command_line.command import Command
from service.command_line.console import Json, failure, say, say_json
from service.command_line.failures import WRONG_SETTING

keys_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="API keys.")
users_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Users of the pages.")
db_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="The database's schema.")


@keys_app.command("create", cls=Command)
def create_key(
    role: Annotated[str, typer.Option(help="viewer, analyst, engineer or admin")],
    operator: Annotated[str | None, typer.Option(help="Bind the key to one operator")] = None,
    owner: Annotated[str, typer.Option(help="Who holds the key")] = "command line",
    expires: Annotated[datetime | None, typer.Option(help="When it stops working (UTC)")] = None,
    scope: Annotated[
        list[str] | None,
        typer.Option(help="read, upload, maintain or admin; repeat it; default: all that the role may"),
    ] = None,
    json_: Json = False,
) -> None:
    """Make an API key and print it once.

    With --json: {"id", "key", "owner", "role", "operator", "scopes", "expires"}; operator, scopes and expires may be null.
    """
    from datetime import UTC  # noqa: PLC0415

    from service.access import audit  # noqa: PLC0415 - heavy, and only here
    from service.access.scopes import shown  # noqa: PLC0415
    from service.access.security import AT_THE_MACHINE, new_key  # noqa: PLC0415
    from service.running import opened  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    settings = Settings()
    try:
        context = opened(settings)
        with context.database.writing() as session:
            ends = expires.replace(tzinfo=UTC) if expires else None
            row, key = new_key(session, owner, role, operator, ends, scope or None)
            scopes = shown(row.scopes)
            details = {"owner": owner, "role": role, "scopes": scopes}
            audit.note(session, AT_THE_MACHINE, "key.make", f"key/{row.id}", operator, details)
            made = {"id": row.id, "key": key, "owner": owner, "role": role, "operator": operator, "scopes": scopes}
    except RuntimeError as error:
        raise failure(str(error), WRONG_SETTING) from None
    except ValueError as error:
        raise failure(str(error)) from None
    context.database.close()
    if json_:
        say_json(made | {"expires": expires.replace(tzinfo=UTC).isoformat() if expires else None})
    else:
        # plain print: the key must come out alone on its line
        print(key)


@users_app.command("create", cls=Command)
def create_user(
    name: Annotated[str, typer.Argument(help="Name to sign in with")],
    role: Annotated[str, typer.Option(help="viewer, analyst, engineer or admin")],
    password: Annotated[
        str, typer.Option(prompt=True, confirmation_prompt=True, hide_input=True, envvar="CASEDRAIN_NEW_PASSWORD")
    ],
    operator: Annotated[str | None, typer.Option(help="Bind the user to one operator")] = None,
    email: Annotated[str | None, typer.Option(help="Address for mails")] = None,
    mail: Annotated[bool, typer.Option("--mail", help="Send mails about alarms there")] = False,
    json_: Json = False,
) -> None:
    """Make a user of the pages; the password is asked for.

    With --json: {"name", "role", "operator", "email", "mail"}; operator and email may be null.
    """
    from service.access import audit  # noqa: PLC0415 - heavy, and only here
    from service.access.security import AT_THE_MACHINE  # noqa: PLC0415
    from service.access.users import new_user  # noqa: PLC0415
    from service.errors import Problem  # noqa: PLC0415
    from service.running import opened  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    try:
        context = opened(Settings())
    except RuntimeError as error:
        raise failure(str(error), WRONG_SETTING) from None
    try:
        with context.database.writing() as session:
            row = new_user(session, name, password, role, operator, email, mail)
            audit.note(session, AT_THE_MACHINE, "user.make", f"user/{row.name}", operator, {"role": role})
    except Problem as problem:
        faults = "".join(f"\n  {f.where}: {f.problem}" for f in problem.errors)
        raise failure(f"{problem.detail}{faults}") from None
    finally:
        context.database.close()
    if json_:
        say_json({"name": name, "role": role, "operator": operator, "email": email, "mail": mail})
    else:
        say(f"User {name} can sign in now.")


@db_app.command("upgrade", cls=Command)
def upgrade_database(json_: Json = False) -> None:
    """Bring the database of the settings to the newest schema.

    With --json: {"status": "up_to_date"}.
    """
    from service.settings import Settings  # noqa: PLC0415
    from service.storage.database import upgrade  # noqa: PLC0415 - heavy, and only here

    settings = Settings()
    upgrade(settings.effective_database_url)
    if json_:
        say_json({"status": "up_to_date"})
    else:
        say("The database is up to date.")
