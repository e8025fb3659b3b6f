"""Settings of `jupyter nbconvert` in this folder: stored notebooks have no times, versions or other
metadata of the machine that executed them."""

c = get_config()  # noqa: F821  # pyright: ignore
c.ExecutePreprocessor.record_timing = False
c.ExecutePreprocessor.timeout = None
c.ClearMetadataPreprocessor.enabled = True
c.ClearMetadataPreprocessor.preserve_nb_metadata_mask = {"kernelspec", ("language_info", "name")}
