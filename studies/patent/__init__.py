"""The claims of JP5484215 over random events, what sharing gains where there is headroom, rules apart, and learning."""
