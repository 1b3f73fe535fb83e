//! Changes of whole paths (Veach and Guibas 1997, "Metropolis Light Transport", section 5; Veach 1997, chapter 11).
//!
//! The bidirectional mutation cuts a piece out of a path and grows another, of any length, and so reaches every path. Three
//! perturbations move a path a little and keep its *labels*: which vertices are smooth, and which delta lobe the others have.
//! They cost few rays and are accepted often, each on its own kind of path.
//!
//! Each gives the two numbers that decide about a proposal, `C(x → y) = f(y) / T(x → y)` and `C(y → x)`. What both have in
//! common is left out: the scalar factors of kept edges (never their colours: the luminance of a product is no product of
//! luminances), and the densities of offsets, which are the same forwards and back. Where a walk repeats delta events no
//! factor but their reflectance is left of them, because the spread of a bundle of rays is part both of `f` and of `T`
//! (METHODS 5.3 and D.1).

mod bidirectional;
mod caustic;
mod lens;
mod multi_chain;
mod trace;

use super::{Failure, Kernels, LogUniform, Proposal};
use crate::sampler::{IndependentSampler, Sampler};
use crate::scene::Scene;
use crate::transport::Path;
use glam::Vec2;

/// A way to change a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mutation {
    /// Another piece, of another length, somewhere in the path: finds new light, and is refused often.
    Bidirectional,
    /// Another raster position, the path behind it repeated up to the first smooth vertex: for paths whose next vertex is
    /// smooth too, and for those that end on an emitter there.
    Lens,
    /// Another direction of light at the last smooth vertex before the one that the lens sees: for caustics.
    Caustic,
    /// Another raster position, and other directions at every smooth vertex that light leaves through delta events: for
    /// caustics seen in mirrors, or from under water.
    MultiChain,
}

impl Mutation {
    /// All of them, in the order of declaration.
    pub const ALL: [Self; 4] = [Self::Bidirectional, Self::Lens, Self::Caustic, Self::MultiChain];

    /// Names for people, in the order of [`Mutation::ALL`].
    pub const NAMES: [&str; 4] = ["bidirectional", "lens", "caustic", "multi-chain"];

    /// Could this mutation change the path? It depends on the labels alone, so that what a perturbation makes of a suitable
    /// path is suitable, too.
    pub fn is_suitable(self, path: &Path<'_>) -> bool {
        match self {
            Self::Bidirectional => true,
            Self::Lens => lens::is_suitable(path),
            Self::Caustic => caustic::is_suitable(path),
            Self::MultiChain => multi_chain::is_suitable(path),
        }
    }

    /// Proposes another path in place of a suitable one.
    ///
    /// # Errors
    /// Why there is none.
    pub fn propose<'s, S: Sampler>(
        self,
        scene: &'s Scene,
        settings: &MutationSettings,
        path: &Path<'s>,
        sampler: &mut S,
    ) -> Result<Proposal<Path<'s>>, Failure> {
        match self {
            Self::Bidirectional => bidirectional::propose(scene, settings, path, sampler),
            Self::Lens => lens::propose(scene, settings, path, sampler),
            Self::Caustic => caustic::propose(scene, settings, path, sampler),
            Self::MultiChain => multi_chain::propose(scene, settings, path, sampler),
        }
    }
}

/// How far mutations go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MutationSettings {
    /// Fewest edges of a path: 1; 2 where emitters are hidden from the camera; 3 where something else renders what is lit
    /// directly.
    pub min_edges: u32,
    /// Most edges of a path. No chain may start with a longer one.
    pub max_edges: u32,
    /// How far raster positions move, in pixels: a tenth of one up to the radius of a disk of 5 % of the picture. Caustics
    /// turn at their origin by angles that move them about as far.
    pub raster: LogUniform,
    /// How far directions turn at the inner smooth vertices of a multi-chain perturbation, in radians: 0.0001 to 0.1 degrees.
    pub turn: LogUniform,
    /// Angle between neighbouring pixels in the middle of the picture, in radians.
    pub pixel_angle: f64,
}

/// Most edges where the scene has no limit: at an albedo of 0.9, one part in 40 000 of the light goes farther.
const MAX_EDGES: u32 = 100;

/// Shortest jump on the film, in pixels (Veach 1997, section 11.4.3.1).
const SHORTEST: f64 = 0.1;

/// Longest jump on the film, as the share of the picture that a disk of that radius covers (Veach 1997, the same section).
const LARGEST_SHARE: f64 = 0.05;

impl MutationSettings {
    /// The settings for a scene; distances and angles are those of Veach 1997.
    pub fn of(scene: &Scene) -> Self {
        let film = &scene.film;
        let longest = (LARGEST_SHARE * film.crop_pixels() as f64 / std::f64::consts::PI).sqrt();
        // Of a picture of a few pixels everything is near.
        let longest = if longest > SHORTEST { longest } else { 2.0 * SHORTEST };
        let [width, height] = [film.width, film.height].map(|pixels| pixels as f32);
        let middle = scene.camera.ray(Vec2::new(width, height) * 0.5, Vec2::splat(0.5)).direction;
        let pixels = f64::from(width) * f64::from(height);
        Self {
            min_edges: if scene.limits.hide_emitters { 2 } else { 1 },
            max_edges: scene.limits.max_depth.unwrap_or(MAX_EDGES),
            raster: LogUniform::new(SHORTEST, longest),
            turn: LogUniform::new(1e-4f64.to_radians(), 0.1f64.to_radians()),
            pixel_angle: (scene.camera.raster_pdf(middle) * pixels).sqrt().recip(),
        }
    }
}

/// Several mutations of the paths of one scene, for [`super::Chain`].
#[derive(Clone, Copy, Debug)]
pub struct Mutations<'s> {
    /// Where the paths are.
    pub scene: &'s Scene,
    /// How far they go.
    pub settings: MutationSettings,
    /// How readily each of [`Mutation::ALL`] is chosen where it is suitable; 0 switches it off. Only the bidirectional one
    /// reaches all paths.
    pub weights: [f64; 4],
}

impl<'s> Kernels for Mutations<'s> {
    type State = Path<'s>;

    fn names(&self) -> &'static [&'static str] {
        &Mutation::NAMES
    }

    fn selection(&self, kernel: usize, state: &Path<'s>) -> f64 {
        if Mutation::ALL[kernel].is_suitable(state) { self.weights[kernel] } else { 0.0 }
    }

    fn propose(
        &mut self,
        kernel: usize,
        state: &Path<'s>,
        numbers: &mut IndependentSampler,
    ) -> Result<Proposal<Path<'s>>, Failure> {
        Mutation::ALL[kernel].propose(self.scene, &self.settings, state, numbers)
    }
}
