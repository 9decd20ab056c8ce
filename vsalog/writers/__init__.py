"""Writers of results and of recordings; every one of them is atomic."""
