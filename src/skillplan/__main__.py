"""``python -m skillplan``."""

from skillplan.cli.app import main

if __name__ == "__main__":
    main()
