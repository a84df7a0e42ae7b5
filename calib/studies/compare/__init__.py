"""The paper's comparison of five made targets and three camera models, repeated in simulation."""
