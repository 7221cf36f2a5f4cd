"""MuJoCo mechanisms as plants: named channels and parameters, operating points, linear models."""
