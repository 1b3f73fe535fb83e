//! What can be chosen from.

use clap::ValueEnum;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Denoiser {
    /// The best there is: `kpcn`, or `bilateral` where the networks cannot run
    #[default]
    Auto,
    /// Leave the noise in
    None,
    /// Cross-bilateral filter with learned parameters
    Bilateral,
    /// The same filter with constant parameters
    BilateralConstant,
    /// Kernel-predicting neural networks, run by onnxruntime
    Kpcn,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Quality {
    /// The smallest networks: about 1.5 seconds of CPU a megapixel
    Fast,
    /// About 3 seconds of CPU a megapixel
    #[default]
    Balanced,
    /// The balanced networks on the picture in six orientations, and the mean of that: six times the CPU
    High,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Adaptive {
    /// With --time, where finding out takes little of it
    #[default]
    Auto,
    /// Always
    On,
    /// Never
    Off,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Integrator {
    /// The best for the scene, as `inspect` tells
    #[default]
    Auto,
    /// Path tracing: walks from the camera
    Path,
    /// Bidirectional path tracing: walks from the camera and from emitters, joined in every way
    Bdpt,
    /// Metropolis sampling in primary sample space (Kelemen et al.)
    Pssmlt,
    /// Metropolis light transport: mutations of whole paths (Veach and Guibas)
    Mlt,
    /// Energy redistribution path tracing: short chains from path-traced seeds (Cline et al.)
    Erpt,
    /// Correlated visibility sampling of direct light, path tracing of all other light
    Visibility,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Mutation {
    /// Another piece of another length: reaches every path
    Bidirectional,
    /// Another place on the film
    Lens,
    /// Another direction of light before its last smooth surface
    Caustic,
    /// Another place on the film, and other directions between mirrors
    MultiChain,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Marks {
    /// Camera rays of their own: unbiased
    #[default]
    Pilot,
    /// The camera rays that they mark: costs nothing, and is biased, less so with more rays
    Same,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Walks {
    /// From the camera and from emitters, as bidirectional path tracing
    #[default]
    Both,
    /// From the camera, as path tracing
    Camera,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Sampler {
    /// Owen-scrambled Sobol points
    #[default]
    Sobol,
    /// Independent random numbers
    Independent,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Strategy {
    /// Choosing points on emitters and walking into them, weighted
    #[default]
    Mis,
    /// Only choosing points on emitters
    Light,
    /// Only walking into emitters
    Bsdf,
}
