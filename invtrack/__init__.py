"""Inversion-based output tracking of flexible, nonminimum-phase mechanisms, validated in MuJoCo."""
