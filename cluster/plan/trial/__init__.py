"""What a trial of integrators tells: figures, and what renders are expected to cost by them."""
