"""Machines, crops and jobs that come with topdress: YAML, described in docs/format-config.md."""
