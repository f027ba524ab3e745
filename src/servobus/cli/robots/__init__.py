"""The verbs of robots: one file per verb, or per few verbs that belong together."""
