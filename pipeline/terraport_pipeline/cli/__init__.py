"""The pipeline's commands; each module offers ``register(app)``, called by :mod:`terraport.cli`."""
