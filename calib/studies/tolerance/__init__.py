"""What a manufacturing error costs a calibration: draws, a linear predictor, budgets, sweeps and crossovers."""
