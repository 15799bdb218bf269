"""File formats: folders of images in, exports of results out."""
