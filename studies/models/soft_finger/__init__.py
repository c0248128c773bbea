"""The soft finger whose images several studies look at; no study by itself."""
