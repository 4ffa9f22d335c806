"""docs/reference, written from the tables the program itself works with, so that it cannot say anything else."""
