"""Files of other programs, from and to robot files: one module per format, and one table of them."""
