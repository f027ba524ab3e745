"""The process that owns the ports: who is on them, who may move what, and what everybody sees."""
