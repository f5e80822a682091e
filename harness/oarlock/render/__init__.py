"""The page kit: charts, templates and folders of pages, independent of what they show."""
