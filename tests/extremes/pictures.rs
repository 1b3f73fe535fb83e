//! Sizes of pictures, numbers of samples and lengths of paths, at the extremes, for all methods.

use super::*;

#[test]
fn pictures_of_few_pixels_are_as_bright_as_path_traced_ones() {
    let mut scene = room(5, r#"<bsdf type="conductor"/>"#);
    for crop in [[4, 5, 1, 1], [6, 0, 1, 12], [0, 7, 12, 1], [3, 8, 2, 2]] {
        scene.film.crop = crop;
        let expected = by_path(&scene, 256);
        for (name, integrator) in methods() {
            let found = replicas(&scene, integrator, REPLICAS, 64);
            assert_same_mean(&found, &expected, &format!("{crop:?}, {name}"));
        }
    }
    // The whole film is one pixel.
    let text = r#"<shape type="sphere"><point name="center" x="0" y="0" z="-4"/></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    assert_like_path(&scene_around(1, 60.0, 4, text), "one pixel");
    assert_like_path(&scene_around(2, 60.0, 4, text), "two by two");
}

#[test]
fn paths_are_as_long_as_they_may_be_and_no_longer() {
    for depth in [1, 2, 100, -1] {
        for hides in [false, true] {
            let mut scene = room(depth, r#"<bsdf type="dielectric"/>"#);
            scene.limits.hide_emitters = hides;
            // The lamp is seen from behind alone: let the camera look up at it.
            scene.film.crop = [0, 0, 12, 7];
            assert_like_path(&scene, &format!("{depth} edges, emitters hidden: {hides}"));
        }
    }
}

#[test]
fn a_crop_window_gets_all_the_light_of_its_chains_and_no_other() {
    // The mean luminance of the picture is the normalisation only if no chain is ever outside, not even to begin with.
    let mut scene = room(5, GREY);
    scene.film.crop = [7, 1, 4, 10];
    let chains = [
        Integrator::Mlt(Mlt { bootstrap_pairs: 1000, separate_direct: false, ..Mlt::default() }),
        Integrator::Pssmlt(Pssmlt { bootstrap_samples: 1000, ..Pssmlt::default() }),
    ];
    for integrator in chains {
        let rendered = rendered(&scene, integrator, 64, 2);
        let (mean, _) = fact(&rendered, "normalisation").split_once(' ').expect("b ± its error");
        let (mean, found): (f64, f64) = (mean.parse().expect("b"), luminance(&rendered));
        assert!((found / mean - 1.0).abs() < 1e-5, "{}: {found}, not {mean}", integrator.name());
    }
}

#[test]
fn a_picture_65536_wide_is_filled_to_its_last_column_and_in_no_wrong_one() {
    // A wall of light, red on the left and blue on the right, so that columns that wrap around would show.
    let scene = scene_from(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"><float name="fov" value="90"/>
        <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="65536"/><integer name="height" value="1"/>
            <rfilter type="box"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate x="-2" z="-1"/></transform>
            <emitter type="area"><rgb name="radiance" value="1 0 0"/></emitter></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate x="2" z="-1"/></transform>
            <emitter type="area"><rgb name="radiance" value="0 0 1"/></emitter></shape></scene>"#,
    );
    for (name, integrator) in methods() {
        if matches!(name, "pssmlt of both walks" | "mlt" | "erpt") {
            continue;
        }
        let rendered = rendered(&scene, integrator, 2, 1);
        let beauty = layer(&rendered, LayerKind::Beauty).0;
        assert_eq!(beauty.dim(), (3, 1, 65536));
        for (channel, wrong) in [(0, 32768..65536), (1, 0..65536), (2, 0..32768)] {
            assert!(
                wrong.clone().all(|x| beauty[[channel, 0, x]] == 0.0),
                "{name}, {channel} {wrong:?}"
            );
        }
        // The pixel of the middle of the film is 1 wide, and the last ones are as bright. Chains come to 1 in 64 of them.
        for (channel, right) in
            [(0, 0..1024), (0, 31744..32768), (2, 32768..33792), (2, 64512..65536)]
        {
            let mean =
                right.clone().map(|x| f64::from(beauty[[channel, 0, x]])).sum::<f64>() / 1024.0;
            assert!((mean - 1.0).abs() < 0.9, "{name}: {mean} in {right:?}");
        }
    }
}
