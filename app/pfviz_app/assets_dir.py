"""Where the app's lessons, icons and pictures lie."""

from pathlib import Path


def assets_path() -> Path:
    """Folder of the packaged assets.

    Returns:
        `pfviz_app/assets` of an installed wheel, or the checkout's top-level `assets` in an editable install.

    Raises:
        FileNotFoundError: if neither exists.
    """
    package = Path(__file__).resolve().parent
    candidates = (package / "assets", package.parents[1] / "assets")
    for folder in candidates:
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"no assets folder: expected {candidates[0]} or {candidates[1]}")
