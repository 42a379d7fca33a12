"""NONSAC itself."""
