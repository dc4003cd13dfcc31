"""``python -m jaxmuscle.cli``: the same as ``jaxmuscle``."""

from jaxmuscle.cli import main

if __name__ == "__main__":
    main()
