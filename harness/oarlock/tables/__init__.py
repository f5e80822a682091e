"""What runs leave behind: schema, Parquet tables, summaries, folders, provenance, the ledger of a suite."""
