//! What is sampled has the density that is stated.

use super::*;

#[test]
fn bsdfs_are_sampled_with_the_density_they_state() {
    let models: Vec<_> = white_models().into_iter().chain(coloured_models()).collect();
    let cases: usize = models.iter().map(|model| directions(model).len()).sum();
    let level = sidak(LEVEL, cases);
    let grid = SphereGrid::uniform(Vec3::Z, 24, 48);
    let mut random = Random::new(11);
    for model in &models {
        for wo in directions(model) {
            let result = grid.test(
                60_000,
                || smooth(draw(&model.bsdf, wo, &mut random)).map(|sample| sample.wi),
                |wi| f64::from(model.bsdf.pdf(wo, wi)),
            );
            assert!(result.p > level, "{} from {wo}: {result:?}", model.name);
        }
    }
}

/// Narrow lobes, in cells that crowd around the direction a smooth surface would scatter to; of glass, the lobe that
/// refracts, or reflects totally.
#[test]
fn nearly_smooth_bsdfs_are_sampled_with_the_density_they_state() {
    let mut random = Random::new(12);
    let alphas = [0.003f32, 0.03];
    let thetas = [0.0f32, 0.4, 0.9, 1.3];
    let level = sidak(LEVEL, DISTRIBUTIONS.len() * alphas.len() * thetas.len() * 3);
    for distribution in DISTRIBUTIONS {
        for alpha in alphas {
            let metal = Bsdf::rough_conductor(gold(), distribution, Vec2::splat(alpha));
            let glass = Bsdf::rough_dielectric(WHITE_GLASS, distribution, Vec2::splat(alpha));
            for theta in thetas {
                let above = direction(theta, 0.7);
                for (bsdf, wo) in [(&metal, above), (&glass, above), (&glass, -above)] {
                    let smooth_bsdf = match bsdf {
                        Bsdf::RoughDielectric(model) => Bsdf::dielectric(model.glass),
                        _ => Bsdf::conductor(gold()),
                    };
                    let axis =
                        smooth_bsdf.sample(wo, 0.999_999, Vec2::ZERO).expect("a direction").wi;
                    let grid = SphereGrid::crowded(axis, 2.0 * f64::from(alpha), 24, 48);
                    let result = grid.test(
                        60_000,
                        || {
                            smooth(draw(bsdf, wo, &mut random))
                                .map(|sample| sample.wi)
                                .filter(|wi| wi.z * axis.z > 0.0)
                        },
                        |wi| if wi.z * axis.z > 0.0 { f64::from(bsdf.pdf(wo, wi)) } else { 0.0 },
                    );
                    assert!(result.p > level, "{bsdf:?} from {wo}: {result:?}");
                }
            }
        }
    }
}

#[test]
fn a_weight_times_its_density_is_the_value() {
    let mut random = Random::new(13);
    for model in white_models().into_iter().chain(coloured_models()) {
        for _ in 0..2000 {
            let wo = random.next_direction();
            let Some(sample) = smooth(draw(&model.bsdf, wo, &mut random)) else { continue };
            let value = model.bsdf.eval(wo, sample.wi);
            assert_eq!(sample.pdf, value.pdf, "{}", model.name);
            assert_eq!(sample.pdf, model.bsdf.pdf(wo, sample.wi), "{}", model.name);
            for channel in 0..3 {
                for (weight, value) in
                    [(sample.diffuse, value.diffuse), (sample.specular, value.specular)]
                {
                    // A division and a multiplication round by 2⁻²⁴ each.
                    let error = (weight[channel] * sample.pdf - value[channel]).abs();
                    assert!(
                        error <= 1.3e-7 * value[channel] + f32::MIN_POSITIVE,
                        "{}: {error}",
                        model.name
                    );
                }
            }
            let eta = if (sample.wi.z > 0.0) == (wo.z > 0.0) {
                1.0
            } else if wo.z > 0.0 {
                model.eta
            } else {
                1.0 / model.eta
            };
            assert!((sample.eta - eta).abs() < 1e-6, "{}", model.name);
        }
    }
}

/// Every model, also those of extreme parameters, gives finite numbers for every pair of unit directions.
#[test]
fn no_direction_breaks_a_bsdf() {
    let mut models: Vec<Bsdf<'static>> =
        white_models().into_iter().chain(coloured_models()).map(|model| model.bsdf).collect();
    for distribution in DISTRIBUTIONS {
        for alpha in [10.0f32, 1.0, 1e-2, 1e-3, 1e-4] {
            models.push(Bsdf::rough_conductor(gold(), distribution, Vec2::new(alpha, 1e-4)));
            for eta in [1.0 + 2e-5, 1.0 - 2e-5, 0.4, 3.0] {
                let glass = Glass { eta, ..WHITE_GLASS };
                models.push(Bsdf::rough_dielectric(glass, distribution, Vec2::splat(alpha)));
                models.push(Bsdf::dielectric(glass));
                models.push(Bsdf::thin_dielectric(glass));
            }
        }
    }
    models.extend([Bsdf::Null, Bsdf::conductor(MIRROR), Bsdf::conductor(gold())]);
    let black = Rgb::BLACK;
    models.extend([Bsdf::diffuse(black), Bsdf::plastic(black, black, Coat::new(1.5, true))]);

    let mut special = vec![Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::NEG_Y];
    for z in [1e-2f32, 1e-4, 1e-8, 1e-20, 1e-38, 1e-42] {
        for sign in [1.0, -1.0] {
            let horizontal = (1.0 - z * z).sqrt();
            special.push(Vec3::new(horizontal, 0.0, sign * z));
            special.push(Vec3::new(-0.6 * horizontal, 0.8 * horizontal, sign * z));
            special.push(Vec3::new(z, 0.0, sign * horizontal));
        }
    }
    let mut random = Random::new(18);
    special.extend((0..20).map(|_| random.next_direction()));
    let numbers = [0.0, 1e-7, 0.3, 0.999, 1.0 - f32::EPSILON / 2.0];
    let is_good =
        |colour: Rgb| colour.to_array().iter().all(|value| value.is_finite() && *value >= 0.0);
    for bsdf in &models {
        assert!(is_good(bsdf.albedo()) && bsdf.albedo().max_component() <= 1.0, "{bsdf:?}");
        for &wo in &special {
            for &wi in special.iter().chain(&[-wo, Vec3::new(-wo.x, -wo.y, wo.z)]) {
                let value = bsdf.eval(wo, wi);
                let fine = is_good(value.diffuse)
                    && is_good(value.specular)
                    && is_good(Rgb::splat(value.pdf));
                assert!(fine, "{bsdf:?} {wo} {wi}: {value:?}");
                assert!(bsdf.has_smooth() || value.pdf == 0.0);
            }
            for lobe in numbers {
                for (x, y) in numbers.iter().flat_map(|&x| numbers.map(|y| (x, y))) {
                    if let Some(sample) = bsdf.sample(wo, lobe, Vec2::new(x, y)) {
                        let fine = is_good(sample.diffuse) && is_good(sample.specular);
                        assert!(fine, "{bsdf:?} {wo} {lobe} {x} {y}: {sample:?}");
                        assert!(
                            sample.pdf > 0.0 && sample.pdf.is_finite(),
                            "{bsdf:?} {wo}: {sample:?}"
                        );
                        assert!(
                            (sample.wi.length() - 1.0).abs() < 1e-5,
                            "{bsdf:?} {wo}: {sample:?}"
                        );
                    }
                }
            }
        }
    }
}
