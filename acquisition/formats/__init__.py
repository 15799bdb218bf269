"""File formats: folders of images in, exports and the report of a result out."""
