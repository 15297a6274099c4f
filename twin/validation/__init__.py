"""The twin held against published evidence: one file per rig, each giving rows of value beside reference."""
