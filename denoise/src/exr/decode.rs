//! The pixels of an EXR file, by a decoder that trusts its input in places: what it would stumble over is refused before.

use std::io::{self, BufReader, ErrorKind, Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};

use ::exr::error::Error;
use ::exr::image::FlatImage;
use ::exr::meta::BlockDescription;
use ::exr::meta::header::Header;
use ::exr::prelude::{MetaData, ReadChannels, ReadLayers, read as exr_reader};

/// Why an EXR file cannot be decoded.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The operating system refused it.
    #[error(transparent)]
    Io(io::Error),
    /// It is no EXR file, is cut off, damaged or of a kind that the decoder does not know.
    #[error("{0}")]
    Damaged(String),
}

impl From<Error> for DecodeError {
    fn from(error: Error) -> Self {
        match error {
            Error::Io(source) if source.kind() != ErrorKind::UnexpectedEof => Self::Io(source),
            Error::Io(_) => Self::Damaged("a file that ends too early".into()),
            error => Self::Damaged(format!("a file that is damaged or not supported ({error})")),
        }
    }
}

/// Decodes all flat parts of an EXR file, at full resolution. `open` gives it from its beginning, twice; it has `length`
/// bytes.
///
/// # Errors
/// Whatever [`DecodeError`] says; also where the header promises far more than the file can hold.
pub fn decode<R: Read + Seek>(
    open: impl Fn() -> io::Result<R>,
    length: u64,
) -> Result<FlatImage, DecodeError> {
    let open = || open().map(BufReader::new).map_err(DecodeError::Io);
    // On this thread, so that a panic inside can be caught.
    catch_unwind(AssertUnwindSafe(|| {
        let meta = MetaData::read_from_buffered(open()?, false)?;
        refuse_absurd_size(&meta.headers, length)?;
        let reader = exr_reader().no_deep_data().largest_resolution_level().all_channels();
        Ok(reader.all_layers().all_attributes().non_parallel().from_buffered(open()?)?)
    }))
    .unwrap_or_else(|_| {
        Err(DecodeError::Damaged("a file whose damage the decoder did not expect".into()))
    })
}

/// Refuses headers that promise far more pixels than a file of `length` bytes can hold, or blocks of absurd size, before
/// memory is asked for.
fn refuse_absurd_size(headers: &[Header], length: u64) -> Result<(), DecodeError> {
    // Deflate packs by 1032 at best (zlib's technical details), and PXR24 leaves out a quarter before; the other codecs
    // pack less. 64 MiB are harmless in any case.
    const MOST_PER_BYTE: u128 = 2048;
    let most = (64 << 20).max(u128::from(length) * MOST_PER_BYTE);
    let bytes = |header: &Header, [width, height]: [usize; 2]| {
        header.channels.bytes_per_pixel as u128 * width as u128 * height as u128
    };
    let layer = |header: &Header| [header.layer_size.width(), header.layer_size.height()];
    let block = |header: &Header| match header.blocks {
        // The decoder asks for a whole tile at once, also where the picture is smaller.
        BlockDescription::Tiles(tiles) => [tiles.tile_size.width(), tiles.tile_size.height()],
        BlockDescription::ScanLines => {
            [header.layer_size.width(), header.compression.scan_lines_per_block()]
        }
    };
    let pixels: u128 = headers.iter().map(|header| bytes(header, layer(header))).sum();
    let blocks = headers.iter().map(|header| bytes(header, block(header))).max();
    for (promised, what) in [(pixels, "pixels"), (blocks.unwrap_or(0), "one block")] {
        if promised > most {
            return Err(DecodeError::Damaged(format!(
                "a header that promises {promised} bytes of {what} in a file of {length} bytes"
            )));
        }
    }
    Ok(())
}
