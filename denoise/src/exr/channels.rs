//! The channel table: which EXR channel is which part of which layer.
//!
//! Ours is `layer.component` (`albedo.R`), `layer.variance.component`, `layer.a.component` and `layer.b.component`,
//! with `R G B` for the picture. Other renderers name the same things in their own way; [`recognise`] knows:
//!
//! - Blender: `ViewLayer.Combined.R`, `ViewLayer.Noisy Image.R`, `ViewLayer.Denoising Albedo.R`, ...;
//! - Mitsuba's `aov` integrator, whose names the scene chooses: the types and the names of its manual (`nn`, `dd.y`);
//! - pbrt-v4's `gbuffer` film: `Albedo.R`, `Ns.X`, `N.X`, `P.X`, `Variance.R` (of a sample, not of the mean);
//! - Tungsten: `color`, `albedo`, `normal`, `depth`, `visibility`, with `Variance`, `A` and `B` behind the name.

use crate::layers::LayerKind;

/// Which image of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Mean over the samples.
    Mean,
    /// Variance of the mean.
    Variance,
    /// Variance of one sample: `n` times the variance of the mean (pbrt's `Variance`).
    SampleVariance,
    /// Mean of the first half of the samples.
    A,
    /// Mean of the second half of the samples.
    B,
}

/// What a channel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Part {
    /// The picture, denoised or not: the plain channels `R G B`.
    Picture,
    /// An image of a layer.
    Layer(LayerKind, Role),
    /// Number of samples.
    Samples,
    /// Number of dropped samples.
    Invalid,
    /// Estimated relative squared error of the picture.
    Error,
}

impl Part {
    /// Names of the part's channels, in order.
    pub(super) fn components(self) -> &'static [&'static str] {
        match self {
            Self::Picture => &["R", "G", "B"],
            Self::Layer(kind, _) => kind.components(),
            Self::Samples | Self::Invalid => &["N"],
            Self::Error => &["Y"],
        }
    }
}

/// A channel's meaning: the part, the index along the part's first axis, and how good the name is (0 is ours).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Meaning {
    pub(super) part: Part,
    pub(super) component: usize,
    pub(super) rank: u8,
}

/// Name of one channel of our own files.
pub(super) fn name(part: Part, component: usize) -> String {
    let component = part.components()[component];
    match part {
        Part::Picture => component.into(),
        Part::Samples => format!("samples.{component}"),
        Part::Invalid => format!("invalid.{component}"),
        Part::Error => format!("error.{component}"),
        Part::Layer(kind, Role::Mean) => format!("{}.{component}", kind.name()),
        Part::Layer(kind, Role::Variance | Role::SampleVariance) => {
            format!("{}.variance.{component}", kind.name())
        }
        Part::Layer(kind, Role::A) => format!("{}.a.{component}", kind.name()),
        Part::Layer(kind, Role::B) => format!("{}.b.{component}", kind.name()),
    }
}

/// What the channel `name` of any renderer's file means, if it means anything to a denoiser.
pub(super) fn recognise(name: &str) -> Option<Meaning> {
    let (group, component) = split(name);
    let (part, rank) = recognise_group(group)?;
    Some(Meaning { part, component: component_index(part, component)?, rank })
}

/// Splits `layer.X` at its last dot; pbrt's older `Nsx` before the axis; `R` and `Z` have no group.
fn split(name: &str) -> (&str, &str) {
    if let Some((group, component)) = name.rsplit_once('.') {
        // `dd.y`, the depth in the example of Mitsuba's manual, may get its `.T` behind or not.
        return if component == "T" && group == "dd.y" {
            ("dd", component)
        } else {
            (group, component)
        };
    }
    for group in ["P", "N", "Ns"] {
        if let Some(axis @ ("x" | "y" | "z")) = name.strip_prefix(group) {
            return (group, axis);
        }
    }
    if matches!(name, "R" | "G" | "B" | "A" | "r" | "g" | "b" | "a") {
        ("", name)
    } else {
        (name, "")
    }
}

fn component_index(part: Part, component: &str) -> Option<usize> {
    if part.components().len() == 1 {
        return matches!(component, "" | "V" | "Z" | "T" | "N" | "Y" | "X" | "R" | "y" | "z")
            .then_some(0);
    }
    match component {
        "R" | "X" | "r" | "x" => Some(0),
        "G" | "Y" | "g" | "y" => Some(1),
        "B" | "Z" | "b" | "z" => Some(2),
        _ => None,
    }
}

fn recognise_group(group: &str) -> Option<(Part, u8)> {
    match group {
        "" => return Some((Part::Picture, 0)),
        "samples" => return Some((Part::Samples, 0)),
        "invalid" => return Some((Part::Invalid, 0)),
        "error" => return Some((Part::Error, 0)),
        "variance" => return Some((Part::Layer(LayerKind::Beauty, Role::Variance), 1)),
        "Variance" => return Some((Part::Layer(LayerKind::Beauty, Role::SampleVariance), 0)),
        _ => {}
    }
    // Our own names.
    let (layer, role) = match group.rsplit_once('.') {
        Some((layer, "variance")) => (layer, Role::Variance),
        Some((layer, "a")) => (layer, Role::A),
        Some((layer, "b")) => (layer, Role::B),
        _ => (group, Role::Mean),
    };
    if let Some(kind) = LayerKind::ALL.into_iter().find(|kind| kind.name() == layer) {
        return Some((Part::Layer(kind, role), 0));
    }
    // Other names: the last word of the path, without case, spaces and underscores.
    let word = group.rsplit('.').next().unwrap_or(group);
    let plain: String =
        word.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_ascii_lowercase();
    if let Some((kind, rank)) = other_name(&plain) {
        return Some((Part::Layer(kind, Role::Mean), rank));
    }
    // Tungsten's endings: `normalVariance`, `normalA`, `normalB`.
    let (stem, role) = if let Some(stem) = plain.strip_suffix("variance") {
        (stem, Role::Variance)
    } else if word.ends_with('A') {
        (plain.strip_suffix('a')?, Role::A)
    } else if word.ends_with('B') {
        (plain.strip_suffix('b')?, Role::B)
    } else {
        return None;
    };
    other_name(stem).map(|(kind, rank)| (Part::Layer(kind, role), rank))
}

/// The layer of another renderer's name. Where a file has two names for one layer, the lower rank is used: Blender's
/// noisy image before its `Combined`, which may be denoised; the shading normal before the geometric one.
fn other_name(plain: &str) -> Option<(LayerKind, u8)> {
    Some(match plain {
        "noisyimage" => (LayerKind::Beauty, 1),
        "beauty" | "color" | "colour" | "combined" | "rgb" | "rgba" | "image" | "myimage" => {
            (LayerKind::Beauty, 2)
        }
        "diffuse" => (LayerKind::Diffuse, 1),
        "specular" => (LayerKind::Specular, 1),
        "albedo" | "denoisingalbedo" => (LayerKind::Albedo, 1),
        "alb" | "albedos" | "basecolor" => (LayerKind::Albedo, 2),
        "diffcol" | "diffusecolor" => (LayerKind::Albedo, 3),
        "normal" | "denoisingnormal" | "ns" | "shnormal" | "shadingnormal" => {
            (LayerKind::Normal, 1)
        }
        "nn" | "normals" | "nrm" => (LayerKind::Normal, 2),
        "n" => (LayerKind::Normal, 3),
        "geonormal" => (LayerKind::Normal, 4),
        "position" => (LayerKind::Position, 1),
        "p" | "pos" | "pp" | "positions" => (LayerKind::Position, 2),
        "depth" | "denoisingdepth" => (LayerKind::Depth, 1),
        "z" | "dd" => (LayerKind::Depth, 2),
        "visibility" => (LayerKind::Visibility, 1),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(kind: LayerKind, role: Role, component: usize) -> (Part, usize) {
        (Part::Layer(kind, role), component)
    }

    #[test]
    fn our_names_are_read_as_they_are_written() {
        let parts = LayerKind::ALL
            .into_iter()
            .flat_map(|kind| {
                [Role::Mean, Role::Variance, Role::A, Role::B].map(|role| Part::Layer(kind, role))
            })
            .chain([Part::Picture, Part::Samples, Part::Invalid, Part::Error]);
        for part in parts {
            for component in 0..part.components().len() {
                let name = name(part, component);
                assert_eq!(recognise(&name), Some(Meaning { part, component, rank: 0 }), "{name}");
                // OpenEXR's limit for files that old readers can open.
                assert!(name.len() <= 31, "{name}");
            }
        }
    }

    #[test]
    fn other_renderers_names_are_known() {
        use LayerKind::*;
        for (name, expected) in [
            ("ViewLayer.Combined.R", layer(Beauty, Role::Mean, 0)),
            ("View Layer.Noisy Image.B", layer(Beauty, Role::Mean, 2)),
            ("ViewLayer.Denoising Albedo.G", layer(Albedo, Role::Mean, 1)),
            ("ViewLayer.Denoising Normal.Z", layer(Normal, Role::Mean, 2)),
            ("ViewLayer.Depth.V", layer(Depth, Role::Mean, 0)),
            ("ViewLayer.Depth.Z", layer(Depth, Role::Mean, 0)),
            ("my_image.R", layer(Beauty, Role::Mean, 0)),
            ("nn.X", layer(Normal, Role::Mean, 0)),
            ("sh_normal.Y", layer(Normal, Role::Mean, 1)),
            ("dd.y", layer(Depth, Role::Mean, 0)),
            ("dd.y.T", layer(Depth, Role::Mean, 0)),
            ("depth.T", layer(Depth, Role::Mean, 0)),
            ("Albedo.B", layer(Albedo, Role::Mean, 2)),
            ("Ns.X", layer(Normal, Role::Mean, 0)),
            ("Nsx", layer(Normal, Role::Mean, 0)),
            ("Nz", layer(Normal, Role::Mean, 2)),
            ("P.Y", layer(Position, Role::Mean, 1)),
            ("Variance.G", layer(Beauty, Role::SampleVariance, 1)),
            ("variance.G", layer(Beauty, Role::Variance, 1)),
            ("Z", layer(Depth, Role::Mean, 0)),
            ("normalVariance.X", layer(Normal, Role::Variance, 0)),
            ("colorA.R", layer(Beauty, Role::A, 0)),
            ("albedoB.R", layer(Albedo, Role::B, 0)),
            ("R", (Part::Picture, 0)),
        ] {
            let found = recognise(name).map(|meaning| (meaning.part, meaning.component));
            assert_eq!(found, Some(expected), "{name}");
        }
    }

    #[test]
    fn channels_without_meaning_are_none() {
        for name in [
            "A",
            "ViewLayer.Combined.A",
            "uv.U",
            "dzdx",
            "RelativeVariance.R",
            "ViewLayer.CryptoObject00.r",
        ] {
            assert_eq!(recognise(name), None, "{name}");
        }
    }
}
