"""Methods of slip control on equal terms: tuned with equal budgets, judged on fresh rails."""
