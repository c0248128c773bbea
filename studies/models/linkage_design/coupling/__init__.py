"""The coupled finger's linkage: how it moves and what it holds, its search and judgement."""
