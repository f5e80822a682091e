"""What runs leave behind: schema, Parquet tables, summaries, folders, provenance and the ledger of a suite."""
