//! Materials: what a surface of some role is made of.

mod texture;

use super::colour;
use super::error::Error;
use super::form::Role;
use super::pattern::Pattern;
use super::random::Random;
use super::stage::{MaterialIndex, Stage};
use super::xml::Element;
use crate::bsdf::{media, metals};
use texture::Look;

/// The kinds of material that an object may be made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Diffuse,
    Plastic,
    RoughPlastic,
    Conductor,
    RoughConductor,
    Dielectric,
    RoughDielectric,
    ThinDielectric,
    Blend,
    Mask,
}

/// A new material for a role.
///
/// # Errors
/// A texture cannot be written.
pub(super) fn for_role(
    stage: &mut Stage,
    role: Role,
    random: &mut Random,
) -> Result<MaterialIndex, Error> {
    let bsdf = Maker { stage, random }.for_role(role)?;
    Ok(stage.add_material(bsdf))
}

struct Maker<'a> {
    stage: &'a mut Stage,
    random: &'a mut Random,
}

impl Maker<'_> {
    fn for_role(&mut self, role: Role) -> Result<Element, Error> {
        use Kind::{
            Blend, Conductor, Dielectric, Diffuse, Mask, Plastic, RoughConductor, RoughDielectric,
            RoughPlastic, ThinDielectric,
        };
        let kinds: &[(f64, Kind)] = match role {
            Role::Wall => &[
                (84.0, Diffuse),
                (9.0, RoughPlastic),
                (4.0, Plastic),
                (2.0, Blend),
                (1.0, RoughConductor),
            ],
            Role::Tiled => &[(30.0, Diffuse), (30.0, RoughPlastic), (40.0, Plastic)],
            Role::Coloured => &[(100.0, Diffuse)],
            Role::Polished => {
                &[(45.0, RoughPlastic), (30.0, Plastic), (20.0, RoughConductor), (5.0, Blend)]
            }
            Role::Ceiling => &[(95.0, Diffuse), (5.0, RoughPlastic)],
            Role::Floor => &[
                (42.0, Diffuse),
                (26.0, RoughPlastic),
                (16.0, Plastic),
                (8.0, Blend),
                (6.0, RoughConductor),
                (2.0, Conductor),
            ],
            Role::Furniture => &[
                (45.0, Diffuse),
                (25.0, RoughPlastic),
                (12.0, Plastic),
                (10.0, RoughConductor),
                (5.0, Blend),
                (3.0, Conductor),
            ],
            Role::Thing(_) => &[
                (22.0, Diffuse),
                (18.0, RoughPlastic),
                (10.0, Plastic),
                (15.0, RoughConductor),
                (6.0, Conductor),
                (9.0, Dielectric),
                (5.0, RoughDielectric),
                (9.0, Blend),
                (2.0, ThinDielectric),
                (3.0, Mask),
            ],
            Role::Sheet => {
                &[(60.0, Diffuse), (15.0, RoughPlastic), (15.0, Mask), (10.0, RoughConductor)]
            }
            Role::Leaf => &[(55.0, Diffuse), (30.0, RoughPlastic), (15.0, Mask)],
            Role::Metal => &[(70.0, RoughConductor), (15.0, Conductor), (15.0, RoughPlastic)],
            Role::Glass => &[(85.0, Dielectric), (15.0, RoughDielectric)],
            Role::Pane => &[(1.0, ThinDielectric)],
            Role::Water => &[(1.0, Dielectric)],
            Role::Mirror => &[(1.0, Conductor)],
            Role::Plate(_) => {
                &[(70.0, RoughConductor), (15.0, RoughPlastic), (8.0, Conductor), (7.0, Plastic)]
            }
            Role::Picture(_) => &[(65.0, Diffuse), (20.0, RoughPlastic), (15.0, Plastic)],
        };
        let kind = self.random.weighted(kinds);
        self.of_kind(kind, role)
    }

    fn of_kind(&mut self, kind: Kind, role: Role) -> Result<Element, Error> {
        let element = match kind {
            Kind::Dielectric | Kind::RoughDielectric | Kind::ThinDielectric => {
                return self.glass(kind, role);
            }
            Kind::Mask => return self.mask(role),
            Kind::Blend => {
                let opaque = [
                    Kind::Diffuse,
                    Kind::RoughPlastic,
                    Kind::RoughConductor,
                    Kind::Plastic,
                    Kind::Conductor,
                ];
                let (first, second) = (self.random.pick(&opaque[..3]), self.random.pick(&opaque));
                let (first, second) = (self.opaque(first, role)?, self.opaque(second, role)?);
                self.stage.tag("blend");
                let blend = Element::plugin("bsdf", "blendbsdf");
                let blend = if self.random.chance(0.6) {
                    blend.child(self.numbers(Look::of_role(role), "weight", [0.0, 1.0])?)
                } else {
                    blend.float("weight", self.random.uniform(0.1, 0.9))
                };
                blend.child(first).child(second)
            }
            _ => self.opaque(kind, role)?,
        };
        let element = if self.random.chance(relief_share(role)) {
            self.relief(element, role)?
        } else {
            element
        };
        Ok(two_sided(element))
    }

    /// A model that lets no light through, not yet two-sided.
    fn opaque(&mut self, kind: Kind, role: Role) -> Result<Element, Error> {
        Ok(match kind {
            Kind::Plastic | Kind::RoughPlastic => {
                let base = self.colour(role, "diffuse_reflectance")?;
                let ior =
                    if self.random.chance(0.7) { 1.49 } else { self.random.uniform(1.3, 1.9) };
                let is_nonlinear = self.random.chance(0.5);
                let name = if kind == Kind::Plastic { "plastic" } else { "roughplastic" };
                self.stage.tag(name);
                let mut model = Element::plugin("bsdf", name)
                    .child(base)
                    .float("int_ior", ior)
                    .boolean("nonlinear", is_nonlinear);
                if self.random.chance(0.15) {
                    model = model.child(self.specular_tint(role, "specular_reflectance")?);
                }
                if kind == Kind::RoughPlastic {
                    let alpha = self.alpha().min(0.6);
                    model = model.string("distribution", self.distribution()).float("alpha", alpha);
                }
                model
            }
            Kind::Conductor | Kind::RoughConductor => self.conductor(kind, role)?,
            _ => {
                self.stage.tag("diffuse");
                let reflectance = self.colour(role, "reflectance")?;
                Element::plugin("bsdf", "diffuse").child(reflectance)
            }
        })
    }

    fn conductor(&mut self, kind: Kind, role: Role) -> Result<Element, Error> {
        let is_rough = kind == Kind::RoughConductor;
        let name = if is_rough { "roughconductor" } else { "conductor" };
        self.stage.tag(name);
        let common = ["Al", "Ag", "Au", "Cu", "Cr", "Ni_palik", "W", "none"];
        let metal = if role == Role::Mirror {
            self.stage.tag("mirror");
            self.random.pick(&["Ag", "Al", "none"])
        } else if self.random.chance(0.75) {
            self.random.pick(&common)
        } else {
            let all: Vec<&str> = metals::names().collect();
            self.random.pick(&all)
        };
        let mut model = Element::plugin("bsdf", name).string("material", metal);
        if role != Role::Mirror && self.random.chance(0.3) {
            model = model.child(self.specular_tint(role, "specular_reflectance")?);
        }
        if is_rough {
            model = model.string("distribution", self.distribution());
            model = match self.random.integer(0, 9) {
                0 | 1 => {
                    let low = self.random.log_uniform(0.03, 0.3);
                    let high = self.random.uniform(low, 0.7);
                    self.stage.tag("roughness-texture");
                    model.child(self.numbers(Look::of_role(role), "alpha", [low, high])?)
                }
                2 | 3 => {
                    let (along, across) = (self.alpha(), self.alpha());
                    self.stage.tag("anisotropic");
                    model.float("alpha_u", along).float("alpha_v", across)
                }
                _ => model.float("alpha", self.alpha()),
            };
        }
        Ok(model)
    }

    fn glass(&mut self, kind: Kind, role: Role) -> Result<Element, Error> {
        let name = match kind {
            Kind::Dielectric => "dielectric",
            Kind::RoughDielectric => "roughdielectric",
            _ => "thindielectric",
        };
        self.stage.tag(name);
        self.stage.tag("glass");
        let mut model = Element::plugin("bsdf", name);
        if role == Role::Water {
            model = model.string("int_ior", "water");
        } else if self.random.chance(0.3) {
            let names: Vec<&str> =
                media::names().filter(|name| media::index(name).is_some_and(|n| n > 1.3)).collect();
            model = model.string("int_ior", self.random.pick(&names));
        } else {
            model = model.float("int_ior", self.random.uniform(1.3, 1.8));
        }
        if self.random.chance(0.35) {
            let saturation = self.random.uniform(0.1, 0.7);
            let tint = colour::hsv(self.random.unit(), saturation, self.random.uniform(0.75, 1.0));
            model = model.rgb("specular_transmittance", tint);
        }
        if kind == Kind::RoughDielectric {
            let alpha = self.alpha().clamp(0.02, 0.6);
            model = model.string("distribution", self.distribution()).float("alpha", alpha);
        }
        Ok(model)
    }

    /// Holes, or a veil.
    fn mask(&mut self, role: Role) -> Result<Element, Error> {
        let inner = self.opaque(Kind::Diffuse, role)?;
        self.stage.tag("mask");
        let mask = Element::plugin("bsdf", "mask");
        let mask = if role != Role::Leaf && self.random.chance(0.7) {
            let patterns = [
                Pattern::Spots,
                Pattern::Stripes,
                Pattern::Checks,
                Pattern::Cells,
                Pattern::Fractal,
            ];
            let pattern = self.random.pick(&patterns);
            mask.child(self.numbers_of(pattern, Look::of_role(role), "opacity", [0.0, 1.0])?)
        } else {
            mask.float("opacity", self.random.uniform(0.3, 0.9))
        };
        Ok(mask.child(two_sided(inner)))
    }

    /// A model under a bump or a normal map.
    fn relief(&mut self, model: Element, role: Role) -> Result<Element, Error> {
        let look = Look::of_role(role);
        if self.random.chance(0.5) {
            self.stage.tag("bumpmap");
            let (map, scale) = self.bump(look)?;
            Ok(Element::plugin("bsdf", "bumpmap").float("scale", scale).child(map).child(model))
        } else {
            self.stage.tag("normalmap");
            let map = self.normals(look)?;
            Ok(Element::plugin("bsdf", "normalmap").child(map).child(model))
        }
    }

    /// A roughness: half log-uniform, half uniform.
    fn alpha(&mut self) -> f64 {
        if self.random.chance(0.6) {
            self.random.log_uniform(0.008, 0.5)
        } else {
            self.random.uniform(0.05, 0.8)
        }
    }

    fn distribution(&mut self) -> &'static str {
        let is_ggx = self.random.chance(0.6);
        self.stage.tag(if is_ggx { "ggx" } else { "beckmann" });
        if is_ggx { "ggx" } else { "beckmann" }
    }
}

/// How many of the materials of a role have a relief.
fn relief_share(role: Role) -> f64 {
    match role {
        Role::Floor | Role::Tiled | Role::Thing(_) => 0.12,
        Role::Wall | Role::Furniture | Role::Sheet => 0.08,
        _ => 0.0,
    }
}

/// The same seen from both sides.
fn two_sided(bsdf: Element) -> Element {
    Element::plugin("bsdf", "twosided").child(bsdf)
}
