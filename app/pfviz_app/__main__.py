"""``python -m pfviz_app`` is ``pfviz``."""

from pfviz_app.cli import main

if __name__ == "__main__":
    main()
