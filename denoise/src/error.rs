//! What can go wrong in image space, each error saying what was expected and what was found.

use std::path::PathBuf;

/// An error of image space: a file, a shape or a number that is not what it must be.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused a file.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file does not hold what it must hold.
    #[error("{path}: found {found}, expected {expected}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// Two images that must have one shape have two.
    #[error("{what} has {}, expected {}", dimensions(found), dimensions(expected))]
    Shape {
        /// Name of the image.
        what: String,
        /// Its channels, height and width.
        found: [usize; 3],
        /// The channels, height and width it must have.
        expected: [usize; 3],
    },
    /// A pixel is NaN or infinite where a number is needed.
    #[error("{what} is {value} at pixel ({x}, {y}), channel {channel}; every pixel must be finite")]
    NonFinite {
        /// Name of the image.
        what: String,
        /// Index of the channel.
        channel: usize,
        /// Column from the left.
        x: usize,
        /// Row from the top.
        y: usize,
        /// The value found.
        value: f32,
    },
    /// A layer that an operation needs is not there.
    #[error("no {missing} layer; found {found}")]
    MissingLayer {
        /// Name of the missing layer.
        missing: String,
        /// Names of the layers there are.
        found: String,
    },
    /// A parameter is out of its range.
    #[error("{name} is {value}, expected {expected}")]
    Parameter {
        /// Name of the parameter.
        name: String,
        /// Its value.
        value: String,
        /// The values it may have.
        expected: &'static str,
    },
    /// onnxruntime could not be loaded; what was tried.
    #[error("onnxruntime cannot be loaded: {0}")]
    OnnxRuntime(String),
    /// A file of weights is not what it must be.
    #[error("model {name}: found {found}, expected {expected}")]
    Model {
        /// Name of the model or its file.
        name: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// A network did not run.
    #[error("model {model} did not run: {reason}")]
    Inference {
        /// Name of the model or its file.
        model: String,
        /// What onnxruntime said.
        reason: String,
    },
}

fn dimensions(&[channels, height, width]: &[usize; 3]) -> String {
    format!("{width}x{height} pixels of {channels} channels")
}
