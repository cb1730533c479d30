"""The command as a user calls it."""
from click.testing import Result
from typer.testing import CliRunner

from console.cli import app


def topdress(*words: object) -> Result:
    """Runs the command with these arguments."""
    return CliRunner().invoke(app, [str(word) for word in words])
