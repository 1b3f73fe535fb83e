//! Layers as one multi-channel EXR file, ours and other renderers'.
//!
//! A file of ours has the picture in `R G B` and every layer under its name (see [`LayerKind`](crate::LayerKind));
//! all samples are 32-bit floats, compressed without loss. What is known of how the picture was made stands in text
//! attributes whose names begin with `quietlight.`; the text attributes of other renderers keep their names.

mod channels;
mod decode;
mod read;
mod separate;
mod write;

pub use channels::Role;
pub use decode::{DecodeError, decode};
pub use read::{Contents, read};
pub use separate::{SeparateFile, read_separate};
pub use write::{WriteOptions, write};

/// Beginning of the names of the attributes that hold [`Layers::metadata`](crate::Layers::metadata).
const ATTRIBUTE_PREFIX: &str = "quietlight.";

/// Where the pixels of a file lie in the whole picture: a crop has an offset, or less pixels than the display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Column and row of the first pixel of the data, in the coordinates of the display.
    pub offset: (i32, i32),
    /// Column and row of the first pixel of the display, nearly always zero.
    pub display_offset: (i32, i32),
    /// Width and height of the whole picture.
    pub display: (usize, usize),
}

impl Frame {
    /// The frame of a picture that is not cropped.
    pub const fn whole(width: usize, height: usize) -> Self {
        Self { offset: (0, 0), display_offset: (0, 0), display: (width, height) }
    }
}

#[cfg(test)]
mod tests;
