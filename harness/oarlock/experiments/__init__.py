"""From a case to finished runs: plan, tasks, laboratory, session."""
