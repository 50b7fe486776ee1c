"""What sharing gains over random events in which there is something to share."""
