"""`python -m servobus` is `servobus`."""

from servobus.cli import main

if __name__ == "__main__":
    main()
