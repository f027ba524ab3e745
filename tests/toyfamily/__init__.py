"""A family of servos that servobus does not know: a distribution of its own would look like this.

    AA AA  id  count  code  data ...  sum        count = bytes of data, sum = low byte of the sum from id on

What is sent has a small code, its answer the same code with the high bit set. All values are two bytes, high byte
first, and are numbered: a cell is the number of a value.
"""

from toyfamily.models import TOY1

MODELS = [TOY1]
"""What the entry point names."""
