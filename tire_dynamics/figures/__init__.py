"""The paper's figures, and the drawings of commands."""
