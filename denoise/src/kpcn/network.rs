//! Networks as onnxruntime runs them; the only file that names the crate `ort`.
//!
//! A network yields logits and nothing else, but for the finest level of a pyramid: what they are made of, which `head`
//! does. What a file of weights must say of itself, in its ONNX metadata: `kind` (`kernel_pyramid` or `kernel`), `branch`
//! (`diffuse` or `specular`), `tier`, `channels` (the names of the input's channels, with commas between), `epsilon` and
//! `version` (3). A file that says anything else is refused.
//!
//! One environment a process; a session is made once for each file and number of threads. Sessions have threads of their
//! own: [`Network::run`] must be called outside of rayon's workers, which would wait for it with nothing to do.

use std::collections::HashMap;
use std::fmt::{self, Display};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::channels;
use super::library::{self, Origin};
use super::model::Model;
use super::pyramid::{FINEST_OUTPUTS, OUTPUTS};
use super::transform::EPSILON;
use crate::error::Error;

/// The one version of the files' metadata.
const VERSION: &str = "3";

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
    /// Kernels of a pyramid of five levels (`pyramid`).
    KernelPyramid,
    /// One kernel of `size`×`size` taps a pixel (`kernel`).
    Kernel {
        /// Taps on a side, odd.
        size: usize,
    },
}

impl Kind {
    /// The input.
    fn input(self) -> Tensor {
        let (channels, halvings) = match self {
            Self::KernelPyramid => (4 * channels::PYRAMID.len(), 1),
            Self::Kernel { .. } => (channels::KERNEL.len(), 0),
        };
        Tensor { name: "input", shape: Shape::Image { channels, halvings } }
    }

    /// The outputs in order; `features` are the channels of the first one of a pyramid.
    fn outputs(self, features: usize) -> Vec<Tensor> {
        let image =
            |name, channels, halvings| Tensor { name, shape: Shape::Image { channels, halvings } };
        let Self::KernelPyramid = self else { return vec![image("logits", features, 0)] };
        let levels = ["level1", "level2", "level3", "level4"].into_iter().zip(OUTPUTS);
        let mut outputs = vec![image("half", features, 1)];
        outputs.extend(levels.map(|(name, (channels, halvings))| image(name, channels, halvings)));
        let constant = |name, sides| Tensor { name, shape: Shape::Constant(sides) };
        outputs.push(constant("level0.weight", vec![FINEST_OUTPUTS, features]));
        outputs.push(constant("level0.bias", vec![FINEST_OUTPUTS]));
        outputs
    }
}

/// An input or output, of 32-bit floats.
#[derive(Debug)]
struct Tensor {
    name: &'static str,
    shape: Shape,
}

#[derive(Debug)]
enum Shape {
    /// `[1, channels, height, width]` of 2^−halvings of the picture's size.
    Image { channels: usize, halvings: usize },
    /// The same whatever the picture.
    Constant(Vec<usize>),
}

impl Shape {
    /// The sides for a picture of that size.
    fn of(&self, [height, width]: [usize; 2]) -> Vec<usize> {
        match self {
            Self::Image { channels, halvings } => {
                vec![1, *channels, height >> halvings, width >> halvings]
            }
            Self::Constant(sides) => sides.clone(),
        }
    }

    /// Whether a file's tensor has it.
    fn is_of(&self, value: &ValueType) -> bool {
        match self {
            Self::Image { channels, .. } => channels_of(value) == Some(*channels),
            Self::Constant(sides) => match value {
                ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } => {
                    shape.iter().copied().eq(sides.iter().map(|side| *side as i64))
                }
                _ => false,
            },
        }
    }
}

impl Display for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.shape {
            Shape::Image { channels, .. } => {
                write!(f, "{}: 32-bit floats [1, {channels}, height, width]", self.name)
            }
            Shape::Constant(sides) => write!(f, "{}: 32-bit floats {sides:?}", self.name),
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
    /// What a run gives, in order.
    outputs: Vec<Tensor>,
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
        let first = session.outputs().first().and_then(|output| channels_of(output.dtype()));
        let first = first.unwrap_or(0);
        let (kind, names) = match say("kind").as_str() {
            "kernel_pyramid" => (Kind::KernelPyramid, &channels::PYRAMID[..]),
            "kernel" => (Kind::Kernel { size: kernel_size(model, first)? }, &channels::KERNEL[..]),
            other => {
                let found = format!("the kind '{other}'");
                return Err(model.refused(found, "'kernel_pyramid' or 'kernel'"));
            }
        };
        expect("channels", &names.join(","))?;
        // A pyramid of no features would be no convolution.
        let outputs = kind.outputs(first.max(1));
        check_tensors(model, "inputs", session.inputs(), &[kind.input()])?;
        check_tensors(model, "outputs", session.outputs(), &outputs)?;
        drop(metadata);
        let session = Mutex::new(Some(session));
        Ok(Self { model: model.clone(), threads, session, outputs, kind, branch })
    }

    /// Runs the network on the `input` of a picture of that height and width (see [`channels`]), and hands its outputs to
    /// `take`, in order: those that [`pyramid::apply`](super::pyramid::apply) takes, or `[size², height, width]`.
    ///
    /// # Errors
    /// [`Error::Inference`] where onnxruntime fails or an output has not the size that follows from the input's.
    pub(super) fn run<T>(
        &self,
        input: Vec<f32>,
        size: [usize; 2],
        take: impl FnOnce(&[&[f32]]) -> T,
    ) -> Result<T, Error> {
        let reason = |error: ort::Error| self.failed(error.to_string());
        let shape = self.kind.input().shape.of(size);
        let tensor = TensorRef::from_array_view((shape, input.as_slice())).map_err(reason)?;
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
        // A large part of the memory in use.
        drop(input);
        let mut slices = Vec::new();
        for Tensor { name, shape: expected } in &self.outputs {
            let output =
                outputs.get(name).ok_or_else(|| self.failed(format!("no output {name}")))?;
            let (shape, values) = output.try_extract_tensor::<f32>().map_err(reason)?;
            if !shape.iter().copied().eq(expected.of(size).into_iter().map(|side| side as i64)) {
                return Err(self.failed(format!("{name} has the shape {:?}", &shape[..])));
            }
            slices.push(values);
        }
        Ok(take(&slices))
    }

    /// Gives back the memory that runs of up to `pixels` have left with the session, if it is much: a session keeps what its
    /// largest run took, some hundred bytes a pixel, and the other branch has one too. The next run makes a new session.
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

/// Taps on a side of the kernels that an output of so many channels has: their square root.
fn kernel_size(model: &Model, channels: usize) -> Result<usize, Error> {
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

/// Checks that a file has these tensors and no others.
fn check_tensors(
    model: &Model,
    what: &str,
    found: &[Outlet],
    expected: &[Tensor],
) -> Result<(), Error> {
    let is_expected = |(found, expected): (&Outlet, &Tensor)| {
        found.name() == expected.name && expected.shape.is_of(found.dtype())
    };
    if found.len() == expected.len() && found.iter().zip(expected).all(is_expected) {
        return Ok(());
    }
    let found: Vec<_> =
        found.iter().map(|tensor| format!("{}: {}", tensor.name(), tensor.dtype())).collect();
    let expected: Vec<_> = expected.iter().map(Tensor::to_string).collect();
    Err(model.refused(format!("the {what} {}", found.join(", ")), &expected.join(", ")))
}
