//! Networks as onnxruntime runs them; the only file that names the crate `ort`.
//!
//! A network yields logits and nothing else. What a file of weights must say of itself, in its ONNX metadata: `kind`
//! (`kernel_pyramid` or `kernel`), `branch` (`diffuse` or `specular`), `tier`, `channels` (the names of the input's
//! channels, with commas between), `epsilon` and `version` (1). A file that says anything else is refused.
//!
//! One environment a process; a session is made once for each file and number of threads. Sessions have threads of their
//! own: [`Network::run`] must be called outside of rayon's workers, which would wait for it with nothing to do.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::channels;
use super::library::{self, Origin};
use super::model::Model;
use super::pyramid::OUTPUTS;
use super::transform::EPSILON;
use crate::error::Error;

/// The one version of the files' metadata.
const VERSION: &str = "1";

/// Which part of the light a network is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Branch {
    /// Light scattered by diffuse lobes, its albedo divided out.
    Diffuse,
    /// All other light.
    Specular,
}

impl Branch {
    /// Both, diffuse first.
    pub const ALL: [Self; 2] = [Self::Diffuse, Self::Specular];

    /// Its name in files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Diffuse => "diffuse",
            Self::Specular => "specular",
        }
    }
}

/// What a network predicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Kernels of a pyramid of four levels (`pyramid`).
    KernelPyramid,
    /// One kernel of `size`×`size` taps a pixel (`kernel`).
    Kernel {
        /// Taps on a side, odd.
        size: usize,
    },
}

impl Kind {
    /// Channels of the input, and the binary logarithm of how much smaller than the picture it is.
    fn input(self) -> (usize, usize) {
        match self {
            Self::KernelPyramid => (4 * channels::PYRAMID.len(), 1),
            Self::Kernel { .. } => (channels::KERNEL.len(), 0),
        }
    }

    /// Names of the outputs, with the same of each.
    fn outputs(self) -> Vec<(String, usize, usize)> {
        match self {
            Self::KernelPyramid => OUTPUTS
                .into_iter()
                .enumerate()
                .map(|(level, (channels, halvings))| (format!("level{level}"), channels, halvings))
                .collect(),
            Self::Kernel { size } => vec![("logits".into(), size * size, 0)],
        }
    }
}

/// The loaded library.
#[derive(Debug)]
pub struct Runtime {
    environment: Environment,
    /// Where it was found.
    pub origin: Origin,
    /// What it says of its build: version, commit, compiler flags.
    pub build: &'static str,
}

/// What runs the networks: the only provider of the libraries that we get.
pub const PROVIDER: &str = "CPUExecutionProvider";

/// onnxruntime, loaded at the first call.
///
/// # Errors
/// [`Error::OnnxRuntime`] with what was tried, the same at every call.
pub fn runtime() -> Result<&'static Runtime, Error> {
    static RUNTIME: OnceLock<Result<Runtime, String>> = OnceLock::new();
    RUNTIME.get_or_init(load_runtime).as_ref().map_err(|tried| Error::OnnxRuntime(tried.clone()))
}

fn load_runtime() -> Result<Runtime, String> {
    let mut tried = Vec::new();
    for origin in library::origins() {
        // Not `ort::init`, which panics where there is no library.
        let loaded = origin.with_path(|path| {
            ort::init_from(path).map_err(|error| error.to_string())?;
            Ok(())
        });
        match loaded {
            Ok(()) => {
                let environment = ort::init()
                    .with_name("quietlight")
                    .with_telemetry(false)
                    .build()
                    .map_err(|error| error.to_string())?;
                return Ok(Runtime { environment, origin, build: ort::info() });
            }
            Err(reason) => tried.push(format!("{origin}: {reason}")),
        }
    }
    Err(tried.join("; "))
}

/// A network ready to run.
#[derive(Debug)]
pub struct Network {
    model: Model,
    threads: usize,
    /// A session runs one input at a time. `None` after its memory was given back, until the next run.
    session: Mutex<Option<Session>>,
    /// What it predicts.
    pub kind: Kind,
    /// Which light it is for.
    pub branch: Branch,
}

impl Network {
    /// The network of a file of weights, run by `threads` threads; made at the first call and kept.
    ///
    /// # Errors
    /// [`Error::OnnxRuntime`] where the library is missing, [`Error::Model`] where the file is not a network that this
    /// program can use.
    pub fn of(model: &Model, threads: usize) -> Result<Arc<Self>, Error> {
        /// By the SHA-256 of the file and the number of threads.
        type Networks = HashMap<(String, usize), Arc<Network>>;
        static NETWORKS: Mutex<Option<Networks>> = Mutex::new(None);
        let runtime = runtime()?;
        let mut networks = NETWORKS.lock().unwrap_or_else(PoisonError::into_inner);
        let networks = networks.get_or_insert_default();
        let key = (model.sha256.clone(), threads);
        if let Some(network) = networks.get(&key) {
            return Ok(network.clone());
        }
        let network = Arc::new(Self::load(runtime, model, threads)?);
        networks.insert(key, network.clone());
        Ok(network)
    }

    fn load(runtime: &Runtime, model: &Model, threads: usize) -> Result<Self, Error> {
        let session =
            session_of(&runtime.environment, &model.bytes, threads).map_err(|reason| {
                model.refused(format!("a file that cannot be loaded ({reason})"), "an ONNX network")
            })?;
        let metadata = session.metadata().map_err(|error| {
            model.refused(format!("no metadata ({error})"), "the metadata of a network")
        })?;
        let say = |key: &str| metadata.custom(key).unwrap_or_else(|| "nothing".into());
        let expect = |key: &str, expected: &str| {
            let found = say(key);
            if found == expected {
                return Ok(());
            }
            Err(model.refused(format!("the {key} '{found}'"), &format!("'{expected}'")))
        };
        expect("version", VERSION)?;
        let branch = say("branch");
        let branch =
            Branch::ALL.into_iter().find(|known| known.name() == branch).ok_or_else(|| {
                model.refused(format!("the branch '{branch}'"), "'diffuse' or 'specular'")
            })?;
        let epsilon = say("epsilon");
        if epsilon.parse() != Ok(EPSILON) {
            return Err(model.refused(format!("the epsilon '{epsilon}'"), &EPSILON.to_string()));
        }
        let outputs = session.outputs();
        let (kind, names) = match say("kind").as_str() {
            "kernel_pyramid" => (Kind::KernelPyramid, &channels::PYRAMID[..]),
            "kernel" => {
                (Kind::Kernel { size: kernel_size(model, outputs)? }, &channels::KERNEL[..])
            }
            other => {
                let found = format!("the kind '{other}'");
                return Err(model.refused(found, "'kernel_pyramid' or 'kernel'"));
            }
        };
        expect("channels", &names.join(","))?;
        let (channels, _) = kind.input();
        check_tensors(model, "inputs", session.inputs(), &[("input".into(), channels, 0)])?;
        check_tensors(model, "outputs", outputs, &kind.outputs())?;
        drop(metadata);
        let session = Mutex::new(Some(session));
        Ok(Self { model: model.clone(), threads, session, kind, branch })
    }

    /// Runs the network on the `input` of a picture of that height and width (see [`channels`]), and hands its outputs to
    /// `take`, in order: those of [`pyramid::OUTPUTS`](super::pyramid::OUTPUTS), or `[size², height, width]`.
    ///
    /// # Errors
    /// [`Error::Inference`] where onnxruntime fails or an output has not the size that follows from the input's.
    pub(super) fn run<T>(
        &self,
        input: &[f32],
        [height, width]: [usize; 2],
        take: impl FnOnce(&[&[f32]]) -> T,
    ) -> Result<T, Error> {
        let reason = |error: ort::Error| self.failed(error.to_string());
        let (channels, halvings) = self.kind.input();
        let shape = [1, channels, height >> halvings, width >> halvings];
        let tensor = TensorRef::from_array_view((shape, input)).map_err(reason)?;
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let session = match &mut *session {
            Some(session) => session,
            none => {
                let environment = &runtime()?.environment;
                let new = session_of(environment, &self.model.bytes, self.threads);
                none.insert(new.map_err(reason)?)
            }
        };
        let outputs = session.run(ort::inputs!["input" => tensor]).map_err(reason)?;
        let mut slices = Vec::new();
        for (name, channels, halvings) in self.kind.outputs() {
            let output =
                outputs.get(&name).ok_or_else(|| self.failed(format!("no output {name}")))?;
            let (shape, values) = output.try_extract_tensor::<f32>().map_err(reason)?;
            let expected = [1, channels, height >> halvings, width >> halvings];
            if shape[..] != expected.map(|side| side as i64) {
                return Err(self.failed(format!("{name} has the shape {:?}", &shape[..])));
            }
            slices.push(values);
        }
        Ok(take(&slices))
    }

    /// Gives back the memory that runs of up to `pixels` have left with the session, if it is much: a session keeps what its
    /// largest run took, about 350 bytes a pixel, and the other branch has one too. The next run makes a new session.
    pub(super) fn release_memory(&self, pixels: usize) {
        // Making a session takes 50 ms, which running this many pixels outweighs ten times.
        const MANY: usize = 1 << 18;
        if pixels > MANY {
            *self.session.lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
    }

    fn failed(&self, reason: String) -> Error {
        Error::Inference { model: self.model.name.clone(), reason }
    }
}

/// Taps on a side of the kernels that the one output has: the square root of its channels.
fn kernel_size(model: &Model, outputs: &[Outlet]) -> Result<usize, Error> {
    let channels = outputs.first().and_then(|output| channels_of(output.dtype())).unwrap_or(0);
    let size = channels.isqrt();
    if size * size == channels && size % 2 == 1 {
        return Ok(size);
    }
    Err(model.refused(format!("{channels} logits a pixel"), "the square of an odd number"))
}

fn session_of(
    environment: &Environment,
    bytes: &[u8],
    threads: usize,
) -> Result<Session, ort::Error> {
    Session::builder(environment)?
        .with_intra_threads(threads)?
        .with_inter_threads(1)?
        // Idle threads would burn the time of the ones that work, ours among them.
        .with_intra_op_spinning(false)?
        // A plan of all memory is kept beside the memory itself: 160 bytes a pixel for nothing gained.
        .with_memory_pattern(false)?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .commit_from_memory(bytes)
}

/// The second dimension of a tensor of four.
fn channels_of(value: &ValueType) -> Option<usize> {
    match value {
        ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } if shape.len() == 4 => {
            usize::try_from(shape[1]).ok()
        }
        _ => None,
    }
}

/// Checks that a file has these tensors and no others, all of 32-bit floats.
fn check_tensors(
    model: &Model,
    what: &str,
    found: &[Outlet],
    expected: &[(String, usize, usize)],
) -> Result<(), Error> {
    let is_expected = |(tensor, (name, channels, _)): (&Outlet, &(String, usize, usize))| {
        tensor.name() == name && channels_of(tensor.dtype()) == Some(*channels)
    };
    if found.len() == expected.len() && found.iter().zip(expected).all(is_expected) {
        return Ok(());
    }
    let found: Vec<_> =
        found.iter().map(|tensor| format!("{}: {}", tensor.name(), tensor.dtype())).collect();
    let expected: Vec<_> = expected
        .iter()
        .map(|(name, channels, _)| format!("{name}: 32-bit floats [1, {channels}, height, width]"))
        .collect();
    Err(model.refused(format!("the {what} {}", found.join(", ")), &expected.join(", ")))
}
