"""The page kit: charts, templates, and folders of pages, whatever they are about."""
