//! What is in a scene: kinds of surfaces, emitters and images, and its size.

use super::Scene;
use super::material::{Material, Model};
use crate::emitter::EmitterKind;
use crate::geometry::Part;
use crate::texture::{Image, Texture};
use glam::{DVec3, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// What a scene is made of. Only materials that a surface has are counted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inventory {
    /// How many surfaces have a lobe of that kind, by its name; a blend has several.
    pub lobes: BTreeMap<&'static str, usize>,
    /// Materials in use.
    pub materials: usize,
    /// Of these, those that may have a delta lobe: perfect mirrors, smooth glass and coats.
    pub delta_materials: usize,
    /// Of these, those with a mask.
    pub masked_materials: usize,
    /// Of these, those with a bump or normal map.
    pub relief_materials: usize,
    /// How many emitters there are of each kind.
    pub emitters: BTreeMap<&'static str, usize>,
    /// Texels across and down of the environment map, if there is one.
    pub environment_map: Option<[usize; 2]>,
    /// Power of the weakest and of the strongest emitter that has any, in watts, mean of the three colours; of light from
    /// infinity, what enters the scene.
    pub power: Option<[f64; 2]>,
    /// The images of materials, largest first.
    pub images: Vec<ImageFacts>,
    /// Corners of the box around everything, in the coordinates of the file; `None` where there is nothing.
    pub bounds: Option<[DVec3; 2]>,
    /// Diagonal of the box around the smallest part that has an extent, in scene units.
    pub smallest_part: Option<f64>,
    /// Bytes of vertices, indices, the tree and all images.
    pub bytes: u64,
}

/// An image that materials look up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ImageFacts {
    /// Memory of its texels.
    pub bytes: u64,
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
}

impl Inventory {
    /// Counts.
    pub fn of(scene: &Scene) -> Self {
        let mut inventory = Self::default();
        let mut used = BTreeSet::new();
        for surface in &scene.surfaces {
            used.insert(surface.material);
            let material = &scene.materials[surface.material.0 as usize];
            for lobe in lobes(material) {
                *inventory.lobes.entry(lobe).or_default() += 1;
            }
        }
        let mut images: Vec<Arc<Image>> = Vec::new();
        for id in used {
            let material = &scene.materials[id.0 as usize];
            inventory.materials += 1;
            inventory.delta_materials += usize::from(material.has_delta());
            inventory.masked_materials += usize::from(!material.is_opaque());
            inventory.relief_materials += usize::from(material.has_relief());
            material.textures(&mut |texture| images_of(texture, &mut images));
        }
        for (kind, power) in scene.emitters.kinds() {
            *inventory.emitters.entry(name(kind)).or_default() += 1;
            if power > 0.0 {
                let [low, high] = inventory.power.unwrap_or([power; 2]);
                inventory.power = Some([low.min(power), high.max(power)]);
            }
        }
        inventory.images = images.iter().map(|image| ImageFacts::of(image)).collect();
        inventory.images.sort_unstable_by(|a, b| b.cmp(a));
        inventory.environment_map = scene.emitters.map_size();
        let corners =
            |(low, high): (Vec3, Vec3)| [low, high].map(|at| at.as_dvec3() + scene.origin);
        inventory.bounds = scene.geometry.bounds().map(corners);
        let parts = scene.geometry.parts();
        inventory.smallest_part =
            parts.iter().map(extent).filter(|&extent| extent > 0.0).reduce(f64::min);
        let images: u64 = inventory.images.iter().map(|image| image.bytes).sum();
        let meshes: u64 = parts.iter().filter_map(Part::mesh).map(|mesh| mesh.bytes()).sum();
        inventory.bytes = images + meshes + scene.geometry.bytes() as u64;
        inventory
    }

    /// Diagonal of the box around everything, in scene units; 0 where there is nothing.
    pub fn diagonal(&self) -> f64 {
        self.bounds.map_or(0.0, |[low, high]| (high - low).length())
    }
}

impl ImageFacts {
    fn of(image: &Image) -> Self {
        Self { bytes: image.bytes(), width: image.width, height: image.height }
    }
}

/// The kinds of a material's lobes, none twice.
fn lobes(material: &Material) -> BTreeSet<&'static str> {
    let mut lobes = BTreeSet::new();
    if !material.is_opaque() {
        lobes.insert("mask");
    }
    material.models(&mut |model| {
        lobes.extend(match model {
            Model::Null => &["null"][..],
            Model::Diffuse(_) => &["diffuse"],
            Model::Conductor { roughness: None, .. } => &["mirror"],
            Model::Conductor { .. } => &["rough metal"],
            Model::Dielectric { roughness: None, .. } => &["glass"],
            Model::Dielectric { .. } => &["rough glass"],
            Model::ThinDielectric { .. } => &["thin glass"],
            Model::Plastic { .. } => &["diffuse", "smooth coat"],
            Model::RoughPlastic { .. } => &["diffuse", "rough coat"],
            Model::Blend { .. } => &[],
        });
    });
    lobes
}

fn images_of(texture: &Texture, images: &mut Vec<Arc<Image>>) {
    match texture {
        Texture::Constant(_) => {}
        Texture::Bitmap(bitmap) => {
            if !images.iter().any(|known| Arc::ptr_eq(known, &bitmap.image)) {
                images.push(Arc::clone(&bitmap.image));
            }
        }
        Texture::Checkerboard(board) => {
            board.textures.iter().for_each(|texture| images_of(texture, images));
        }
    }
}

fn name(kind: EmitterKind) -> &'static str {
    match kind {
        EmitterKind::Area => "area",
        EmitterKind::Point => "point",
        EmitterKind::Spot => "spot",
        EmitterKind::Directional => "directional",
        EmitterKind::Constant => "constant environment",
        EmitterKind::Map => "environment map",
    }
}

/// Diagonal of the box around a part; about, for those that are no mesh.
fn extent(part: &Part) -> f64 {
    match part {
        Part::Mesh(mesh) => {
            let finite = mesh.positions.iter().filter(|at| at.is_finite()).map(|at| at.as_dvec3());
            let bounds = finite.fold(None, |bounds, at| match bounds {
                None => Some((at, at)),
                Some((low, high)) => Some((at.min(low), at.max(high))),
            });
            bounds.map_or(0.0, |(low, high): (DVec3, DVec3)| (high - low).length())
        }
        Part::Sphere { radius, .. } => 2.0 * 3f64.sqrt() * f64::from(*radius),
        Part::Disk { axes: [a, b], .. } => 2.0 * f64::hypot(a.length().into(), b.length().into()),
        Part::Cylinder { start, end, radius, .. } => {
            let length = f64::from((*end - *start).length());
            f64::hypot(length, 2.0 * f64::from(*radius))
        }
    }
}
