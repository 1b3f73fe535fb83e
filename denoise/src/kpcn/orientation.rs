//! The eight symmetries of the square. A network knows no up and no left, but its answer depends on them: the mean of its
//! answers to a picture seen in several ways is nearer the truth than one.

use rayon::prelude::*;

use crate::layers::Image;

/// How a picture is turned: its axes are exchanged, or not; then its rows and columns run backwards, or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Orientation {
    is_transposed: bool,
    /// Of the turned picture: whether rows, whether columns run backwards.
    is_backward: [bool; 2],
}

/// As it is, and the seven others.
pub(super) const ALL: [Orientation; 8] = {
    let mut all = [Orientation { is_transposed: false, is_backward: [false; 2] }; 8];
    let mut index = 0;
    while index < 8 {
        all[index] = Orientation {
            is_transposed: index & 4 != 0,
            is_backward: [index & 2 != 0, index & 1 != 0],
        };
        index += 1;
    }
    all
};

impl Orientation {
    /// Height and width of a turned picture of that height and width; and the other way round.
    pub(super) fn size(self, [height, width]: [usize; 2]) -> [usize; 2] {
        if self.is_transposed { [width, height] } else { [height, width] }
    }

    /// Where pixel `[y, x]` of the turned picture, of that height and width, was before.
    pub(super) fn source(self, pixel: [usize; 2], size: [usize; 2]) -> [usize; 2] {
        let [y, x] = self.reflected(pixel, size);
        if self.is_transposed { [x, y] } else { [y, x] }
    }

    /// Where a pixel `[y, x]` is in the turned picture, of that height and width.
    pub(super) fn place(self, [y, x]: [usize; 2], size: [usize; 2]) -> [usize; 2] {
        self.reflected(if self.is_transposed { [x, y] } else { [y, x] }, size)
    }

    /// A pixel counted from the other end along the axes that run backwards.
    fn reflected(self, pixel: [usize; 2], size: [usize; 2]) -> [usize; 2] {
        std::array::from_fn(|axis| match self.is_backward[axis] {
            true => size[axis] - 1 - pixel[axis],
            false => pixel[axis],
        })
    }

    /// An image, `[channels, height, width]`, turned.
    pub(super) fn turn(self, image: &Image) -> Image {
        let (channels, height, width) = image.dim();
        let size = self.size([height, width]);
        let source = image.as_slice().expect("layers are made plain when they are taken");
        let mut turned = vec![0.0; source.len()];
        turned.par_chunks_mut(size[1]).enumerate().for_each(|(row, out)| {
            let (channel, y) = (row / size[0], row % size[0]);
            let plane = &source[channel * height * width..][..height * width];
            for (x, out) in out.iter_mut().enumerate() {
                let [y, x] = self.source([y, x], size);
                *out = plane[y * width + x];
            }
        });
        Image::from_shape_vec((channels, size[0], size[1]), turned)
            .expect("as many pixels as before")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Axis;

    #[test]
    fn turning_is_what_it_says() {
        let image = Image::from_shape_fn((2, 3, 5), |(c, y, x)| (100 * c + 10 * y + x) as f32);
        let mut seen: Vec<Image> = Vec::new();
        for orientation in ALL {
            let mut expected = image.view();
            if orientation.is_transposed {
                expected.swap_axes(1, 2);
            }
            for (axis, is_backward) in orientation.is_backward.into_iter().enumerate() {
                if is_backward {
                    expected.invert_axis(Axis(axis + 1));
                }
            }
            let turned = orientation.turn(&image);
            assert_eq!(turned, expected, "{orientation:?}");
            let size = orientation.size([3, 5]);
            for (y, x) in (0..size[0]).flat_map(|y| (0..size[1]).map(move |x| (y, x))) {
                assert_eq!(orientation.place(orientation.source([y, x], size), size), [y, x]);
            }
            assert!(!seen.contains(&turned), "{orientation:?} twice");
            seen.push(turned);
        }
        assert_eq!(ALL[0].turn(&image), image);
    }
}
