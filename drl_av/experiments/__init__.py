"""The paper's systems and figures, made anew by ``drl-av reproduce``."""
