"""What happens to a cluster, as a log of JSON lines and as metrics for Prometheus. docs/monitoring.md lists it all."""
