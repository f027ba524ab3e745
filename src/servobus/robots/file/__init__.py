"""The robot file: what a robot consists of, as TOML that people read and git keeps."""
