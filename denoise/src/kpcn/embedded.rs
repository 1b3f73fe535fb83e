//! What the build put into the library: onnxruntime and the files of weights. Written by `build.rs`.

include!(concat!(env!("OUT_DIR"), "/embedded.rs"));
