//! Surfaces keep light, and make none.

use super::*;

/// The mean of the weights is the integral of the value: nothing is lost between sampling and evaluation.
#[test]
fn sampled_and_integrated_albedo_agree() {
    let mut random = Random::new(14);
    let grid = SphereGrid::uniform(Vec3::Z, 24, 48);
    let models: Vec<_> = white_models().into_iter().chain(coloured_models()).collect();
    let level = sidak(LEVEL, models.iter().map(|model| directions(model).len()).sum());
    for model in &models {
        for wo in directions(model) {
            let weights: Mean = (0..20_000)
                .map(|_| {
                    smooth(draw(&model.bsdf, wo, &mut random))
                        .map_or(0.0, |sample| f64::from((sample.diffuse + sample.specular).mean()))
                })
                .collect();
            let value = |wi: Vec3| {
                let eval = model.bsdf.eval(wo, wi);
                f64::from((eval.diffuse + eval.specular).mean())
            };
            let albedo: f64 = grid.integrate(value).iter().sum();
            // A constant weight differs by rounding alone, and the quadrature is good to four digits.
            let is_close = (weights.mean() - albedo).abs() < 1e-4 * albedo;
            assert!(
                is_close || weights.p_against(albedo) > level,
                "{} from {wo}: {} {albedo}",
                model.name,
                weights.mean()
            );
        }
    }
}

/// All light that leaves the surface, deltas included, as a part of what came: `Σ` over delta lobes and `∫` over the
/// smooth ones, with the compression of radiance taken out.
fn reflected_energy(model: &Model, wo: Vec3) -> f64 {
    let grid = SphereGrid::uniform(Vec3::Z, 24, 48);
    let smooth: f64 = grid
        .integrate(|wi| {
            let value = model.bsdf.eval(wo, wi);
            f64::from((value.diffuse + value.specular).max_component()) * model.compression(wo, wi)
        })
        .iter()
        .sum();
    // The models here have at most two delta lobes, one at either end of the lobe number.
    let ends = [0.0, 1.0 - f32::EPSILON].map(|lobe| model.bsdf.sample(wo, lobe, Vec2::splat(0.5)));
    let mut deltas: Vec<BsdfSample> = Vec::new();
    for sample in ends.into_iter().flatten().filter(|sample| sample.is_delta()) {
        if deltas.iter().all(|known| known.wi != sample.wi) {
            deltas.push(sample);
        }
    }
    let delta: f64 = deltas
        .iter()
        .map(|sample| {
            f64::from(sample.specular.max_component() * sample.pdf)
                * model.compression(wo, sample.wi)
        })
        .sum();
    smooth + delta
}

#[test]
fn no_surface_makes_light() {
    for model in white_models().into_iter().chain(coloured_models().into_iter().take(4)) {
        for wo in directions(&model) {
            let energy = reflected_energy(&model, wo);
            // The quadrature is good to four digits.
            assert!(energy <= 1.0 + 1e-4 && energy > 0.1, "{} from {wo}: {energy}", model.name);
        }
    }
}

#[test]
fn white_models_without_loss_return_all_light() {
    let thin = Bsdf::thin_dielectric(WHITE_GLASS);
    let models = [
        Model::new("mirror", Bsdf::conductor(MIRROR)),
        Model { name: "glass".into(), bsdf: Bsdf::dielectric(WHITE_GLASS), eta: 1.5 },
        // The wave passes straight: no compression.
        Model::new("sheet", thin),
        Model::new("diffuse", Bsdf::diffuse(Rgb::WHITE)),
        // What the coat lets in, a white base returns in the end: (1 - F)(1 - F̄out) / (η² (1 - F̄in)) = 1 - F.
        Model::new("plastic", Bsdf::plastic(Rgb::WHITE, Rgb::WHITE, Coat::new(1.5, false))),
        Model::new(
            "nonlinear plastic",
            Bsdf::plastic(Rgb::WHITE, Rgb::WHITE, Coat::new(1.9, true)),
        ),
        Model::new("nothing", Bsdf::Null),
    ];
    for model in models {
        for wo in directions(&model) {
            let energy = reflected_energy(&model, wo);
            assert!((energy - 1.0).abs() < 1e-4, "{} from {wo}: {energy}", model.name);
        }
    }
}

#[test]
fn the_thin_sheet_reflects_the_sum_of_its_inner_reflections() {
    // Refraction in and out again and k reflections between: R = F + (1-F)² F Σ F^2k = 2F / (1+F).
    for degrees in [0.0f32, 30.0, 60.0, 85.0] {
        let wo = direction(degrees.to_radians(), 1.0);
        let face =
            Bsdf::dielectric(WHITE_GLASS).sample(wo, 0.0, Vec2::ZERO).expect("a reflection").pdf;
        let sheet = Bsdf::thin_dielectric(WHITE_GLASS)
            .sample(wo, 0.0, Vec2::ZERO)
            .expect("a reflection")
            .pdf;
        assert!((sheet - 2.0 * face / (1.0 + face)).abs() < 1e-6);
    }
}
