//! What a scene requires, and what will therefore run.

use super::{megabytes, say};
use crate::film::Film;
use crate::geometry::Part;
use crate::integrator::{Choice, Effort, Purpose};
use crate::render::RenderSettings;
use crate::render::survey::Survey;
use crate::scene::{Inventory, Requirements, Scene};
use quietlight_denoise::kpcn::Branch;
use quietlight_denoise::{Denoiser, LayerKind};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// All that is known before anything is rendered.
pub(super) struct Facts {
    pub(super) requirements: Requirements,
    pub(super) choice: Choice,
    inventory: Inventory,
    survey: Survey,
}

impl Facts {
    /// Looks at the scene, and sends some walks into it.
    pub(super) fn of(scene: &Scene, is_denoised: bool) -> Self {
        let purpose = Purpose { is_denoised, effort: Some(Effort::Samples(scene.samples)) };
        Self {
            requirements: Requirements::of(scene),
            choice: Choice::of(scene, purpose),
            inventory: Inventory::of(scene),
            survey: Survey::of(scene, &RenderSettings::default()),
        }
    }

    pub(super) fn json(&self, scene: &Scene, denoiser: Option<&Denoiser>) -> Value {
        let Self { requirements, choice, inventory, survey } = self;
        let parts = scene.geometry.parts();
        let images: Vec<Value> = inventory
            .images
            .iter()
            .map(
                |image| json!({"width": image.width, "height": image.height, "bytes": image.bytes}),
            )
            .collect();
        json!({
            "width": scene.film.crop[2],
            "height": scene.film.crop[3],
            "samples": scene.samples,
            "max_depth": scene.limits.max_depth,
            "rr_depth": scene.limits.rr_depth,
            "parts": parts.len(),
            "triangles": triangles(scene),
            "analytic_shapes": parts.iter().filter(|part| part.mesh().is_none()).count(),
            "bounds": inventory.bounds.map(|corners| corners.map(|corner| corner.to_array())),
            "diagonal": inventory.diagonal(),
            "smallest_part": inventory.smallest_part,
            "origin": scene.origin.to_array(),
            "materials": inventory.materials,
            "delta_materials": inventory.delta_materials,
            "masked_materials": inventory.masked_materials,
            "relief_materials": inventory.relief_materials,
            "lobes": inventory.lobes,
            "images": images,
            "emitters": scene.emitters.len(),
            "emitter_kinds": inventory.emitters,
            "emitter_power": inventory.power,
            "environment_map": inventory.environment_map,
            "has_specular": requirements.has_specular,
            "has_delta": requirements.has_delta,
            "has_masks": requirements.has_masks,
            "has_defocus": requirements.has_defocus,
            "light": {
                "hits_per_walk": survey.hits,
                "background": survey.background,
                "delta_hits": survey.delta_hits,
                "longest_delta_chain": survey.longest_delta_chain,
                "mean_luminance": survey.mean,
                "brightest_sample": survey.brightest_sample,
                "darkest_and_brightest_cell": survey.cells,
                "invalid_samples": survey.invalid,
            },
            "layers": self.layers(),
            "networks": networks(denoiser, requirements),
            "integrator": choice.integrator.name(),
            "integrator_reason": choice.reason,
            "light_sampling": light_sampling(inventory),
            "film_megabytes": Film::bytes(scene.film, requirements) as f64 / 1e6,
            "tree_megabytes": scene.geometry.bytes() as f64 / 1e6,
            "scene_megabytes": inventory.bytes as f64 / 1e6,
            "left_out": requirements.left_out(),
            "warnings": scene.warnings,
        })
    }

    pub(super) fn print(&self, scene: &Scene, denoiser: Option<&Denoiser>) {
        let Self { requirements, choice, inventory, survey } = self;
        let [_, _, width, height] = scene.film.crop;
        let depth = scene
            .limits
            .max_depth
            .map_or("without limit".to_owned(), |depth| format!("up to {depth} edges"));
        say(
            "picture",
            format!("{width}x{height}, {} samples per pixel, paths {depth}", scene.samples),
        );
        let parts = scene.geometry.parts();
        let analytic = parts.iter().filter(|part| part.mesh().is_none()).count();
        let (triangles, bytes) = (triangles(scene), megabytes(inventory.bytes));
        say(
            "geometry",
            format!(
                "{} parts: {triangles} triangles, {analytic} analytic shapes; {bytes} with images",
                parts.len()
            ),
        );
        if let Some([low, high]) = inventory.bounds {
            let [x, y, z] = (high - low).to_array().map(number);
            let smallest = inventory.smallest_part.map_or(String::new(), |smallest| {
                let ratio = inventory.diagonal() / smallest;
                format!("; the smallest part is 1/{} of the diagonal", number(ratio))
            });
            say("extent", format!("{x} x {y} x {z} around {}{smallest}", triple(low, high)));
        }
        say("camera", if requirements.has_defocus { "a lens: defocus" } else { "a pinhole" });
        let special = [
            (inventory.delta_materials, "delta"),
            (inventory.masked_materials, "masked"),
            (inventory.relief_materials, "bumped"),
        ];
        let special = special.iter().filter(|(count, _)| *count > 0);
        let special: String = special.map(|(count, what)| format!(", {count} {what}")).collect();
        say(
            "materials",
            format!("{}{special}; surfaces: {}", inventory.materials, listed(&inventory.lobes)),
        );
        say("images", self.images());
        let power = inventory.power.map_or(String::new(), |[low, high]| {
            let high = number(high);
            match number(low) {
                low if low == high => format!("; {high} W"),
                low => format!("; {low} to {high} W"),
            }
        });
        say("emitters", format!("{}{power}", listed(&inventory.emitters)));
        say("light", light(survey));
        say("integrator", format!("{}: {}", choice.integrator.name(), choice.reason));
        say("sampling", light_sampling(inventory));
        let film = megabytes(Film::bytes(scene.film, requirements));
        say("layers", format!("{} ({film})", self.layers().join(", ")));
        say("denoiser", plan(denoiser, requirements));
    }

    fn layers(&self) -> Vec<&'static str> {
        let layers = LayerKind::ALL.into_iter().filter(|&layer| self.requirements.needs(layer));
        layers.map(LayerKind::name).collect()
    }

    fn images(&self) -> String {
        const SHOWN: usize = 4;
        let images = &self.inventory.images;
        let environment = self
            .inventory
            .environment_map
            .map(|[width, height]| format!("{width}x{height} around the scene"));
        let largest = images
            .iter()
            .take(SHOWN)
            .map(|image| format!("{}x{} ({})", image.width, image.height, megabytes(image.bytes)));
        let mut shown: Vec<String> = environment.into_iter().chain(largest).collect();
        if images.len() > SHOWN {
            let rest = images[SHOWN..].iter().map(|image| image.bytes).sum();
            shown.push(format!("{} more ({})", images.len() - SHOWN, megabytes(rest)));
        }
        if shown.is_empty() { "none".to_owned() } else { shown.join(", ") }
    }
}

fn triangles(scene: &Scene) -> usize {
    scene.geometry.parts().iter().filter_map(Part::mesh).map(|mesh| mesh.triangles.len()).sum()
}

/// Names and counts, the most frequent first.
fn listed(counts: &BTreeMap<&'static str, usize>) -> String {
    let mut counts: Vec<(usize, &str)> =
        counts.iter().map(|(name, count)| (*count, *name)).collect();
    counts.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(b.1)));
    let names: Vec<String> = counts.iter().map(|(count, name)| format!("{count} {name}")).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// Three digits that count.
fn number(value: f64) -> String {
    match value.abs() {
        size if size == 0.0 || (1e-2..1e5).contains(&size) => {
            let digits =
                if size >= 100.0 { 0 } else { 2 - size.max(0.1).log10().floor() as usize % 3 };
            format!("{value:.digits$}")
        }
        _ => format!("{value:.2e}"),
    }
}

fn triple(low: glam::DVec3, high: glam::DVec3) -> String {
    let [x, y, z] = ((low + high) * 0.5).to_array().map(number);
    format!("({x}, {y}, {z})")
}

/// What a short look found of the light.
fn light(survey: &Survey) -> String {
    let range = survey.cells.map_or("the picture is black".to_owned(), |[low, high]| {
        let stops = (high / low).log2();
        format!(
            "luminance {} on average, parts of the picture {} to {} ({stops:.1} stops), samples to {}",
            number(survey.mean),
            number(low),
            number(high),
            number(survey.brightest_sample)
        )
    });
    let chains = match survey.longest_delta_chain {
        0 => "no delta chains".to_owned(),
        longest => format!(
            "{:.0} % of hits are delta, up to {longest} in a row",
            100.0 * survey.delta_hits
        ),
    };
    format!("{range}; {:.1} hits a walk, {chains}", survey.hits)
}

/// How emitters are chosen.
fn light_sampling(inventory: &Inventory) -> &'static str {
    match inventory.emitters.values().sum::<usize>() {
        0 => "none: there is no emitter",
        1 => "the one emitter, and what scattering finds, weighted against each other",
        _ => {
            "one emitter a hit, chosen by power, and what scattering finds, weighted against each other"
        }
    }
}

/// The networks that will run.
fn networks(denoiser: Option<&Denoiser>, requirements: &Requirements) -> Vec<&'static str> {
    if !matches!(denoiser, Some(Denoiser::Kpcn { .. })) {
        return Vec::new();
    }
    let mut branches = vec![Branch::Diffuse];
    if requirements.needs(LayerKind::Specular) {
        branches.push(Branch::Specular);
    }
    branches.into_iter().map(Branch::name).collect()
}

/// What will take the noise out.
fn plan(denoiser: Option<&Denoiser>, requirements: &Requirements) -> String {
    match denoiser {
        None => "none: the noise stays".to_owned(),
        Some(Denoiser::Bilateral { name, .. }) => format!("cross-bilateral filter ({name})"),
        Some(Denoiser::Kpcn { quality, .. }) => {
            let quality = quality.map(|quality| format!("{} quality", quality.name()));
            let which = networks(denoiser, requirements).join(" and ");
            format!("neural networks, {}: {which}", quality.as_deref().unwrap_or("your own"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_have_three_digits_that_count() {
        for (value, expected) in [
            (0.0, "0.00"),
            (0.0123, "0.01"),
            (0.5, "0.50"),
            (1.234, "1.23"),
            (12.34, "12.3"),
            (1234.5, "1234"),
            (1.5e6, "1.50e6"),
            (-3.2e-7, "-3.20e-7"),
        ] {
            assert_eq!(number(value), expected);
        }
    }
}
