"""An upright rectangle of an image's pixels: the paper's W_ROI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .checks import as_image, as_number, as_points, as_whole


@dataclass(frozen=True)
class Window:
    """An upright rectangle of whole pixels, W_ROI of Sect. 4.2.

    Attributes
    ----------
    u, v : int
        Its first column and row. They may lie outside an image until the window is `clipped`.
    width, height : int
        px, at least 1.
    """

    u: int
    v: int
    width: int
    height: int

    def __post_init__(self) -> None:
        for name, low in (("u", -(2**31)), ("v", -(2**31)), ("width", 1), ("height", 1)):
            object.__setattr__(self, name, as_whole(getattr(self, name), name, low, 2**31))

    @classmethod
    def around(cls, uv: ArrayLike) -> Window | None:
        """The smallest window whose pixels hold the points uv (n, 2), px; NaN rows are left out,
        None if all are.
        """
        points = as_points(uv, "uv", 2)
        points = points[~np.isnan(points).any(axis=1)]
        if len(points) == 0:
            return None
        (u, v) = np.floor(points.min(axis=0) + 0.5)
        (last_u, last_v) = np.floor(points.max(axis=0) + 0.5)
        return cls(u, v, last_u - u + 1, last_v - v + 1)

    @property
    def area(self) -> int:
        """Number of its pixels."""
        return self.width * self.height

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle (u, v) in px; half a pixel off the grid where a side is even."""
        return self.u + (self.width - 1) / 2, self.v + (self.height - 1) / 2

    def contains(self, uv: ArrayLike) -> np.ndarray:
        """The points uv (n, 2) that lie on its pixels, bool (n,); NaN rows do not."""
        offset = as_points(uv, "uv", 2) - (self.u - 0.5, self.v - 0.5)
        return np.all((offset >= 0) & (offset < (self.width, self.height)), axis=1)

    def clipped(self, size: tuple[int, int]) -> Window | None:
        """The part of it inside an image of `size` (width, height); None if there is none."""
        u = max(self.u, 0)
        v = max(self.v, 0)
        width = min(self.u + self.width, size[0]) - u
        height = min(self.v + self.height, size[1]) - v
        return Window(u, v, width, height) if width > 0 and height > 0 else None

    def grown(self, margin_px: float) -> Window:
        """The window with a margin on each side, rounded up to whole pixels."""
        margin = int(np.ceil(as_number(margin_px, "margin_px", 0.0, 2**30)))
        return Window(
            self.u - margin, self.v - margin, self.width + 2 * margin, self.height + 2 * margin
        )

    def crop(self, image: ArrayLike) -> np.ndarray:
        """The part of an image (height, width) under it, as a view; its pixel (0, 0) is (u, v) of
        the whole.

        Raises ValueError if the window is not inside the image.
        """
        grey = as_image(image, "image")
        if self.clipped((grey.shape[1], grey.shape[0])) != self:
            raise ValueError(
                f"image: expected one that holds {self}, got {grey.shape[1]} x {grey.shape[0]} pixels"
            )
        return grey[self.v : self.v + self.height, self.u : self.u + self.width]
