//! What a scene requires of a renderer, so that nothing else is modelled.

use super::Scene;
use quietlight_denoise::LayerKind;

/// Facts about a scene that decide what runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Requirements {
    /// Is there any light that is not scattered by a diffuse lobe first: a lobe that is not diffuse, or an emitter
    /// that the camera could see?
    pub has_specular: bool,
    /// Are there paths of more than one bounce, so that a second hit counts?
    pub has_second_hit: bool,
    /// Is there any emitter, so that shadow rays are traced?
    pub has_emitters: bool,
    /// Can rays pass through surfaces unscattered?
    pub has_masks: bool,
    /// Is the lens of finite size?
    pub has_defocus: bool,
    /// Is there a perfect mirror or smooth glass?
    pub has_delta: bool,
}

impl Requirements {
    /// Reads them off a scene.
    pub fn of(scene: &Scene) -> Self {
        let can_see_emitters = !scene.limits.hide_emitters && scene.emitters.has_visible();
        let used =
            || scene.surfaces.iter().map(|surface| &scene.materials[surface.material.0 as usize]);
        Self {
            has_specular: can_see_emitters || used().any(|material| !material.is_diffuse_only()),
            has_second_hit: scene.limits.max_depth.is_none_or(|depth| depth > 1),
            has_emitters: !scene.emitters.is_dark(),
            has_masks: scene.has_masks,
            has_defocus: scene.camera.has_lens(),
            has_delta: used().any(|material| material.has_delta()),
        }
    }

    /// Is that layer worth accumulating? One that would be the same number everywhere is not.
    pub fn needs(&self, layer: LayerKind) -> bool {
        match layer {
            LayerKind::Specular => self.has_specular,
            LayerKind::Texture2 => self.has_second_hit,
            LayerKind::Visibility => self.has_emitters,
            LayerKind::Beauty
            | LayerKind::Diffuse
            | LayerKind::Albedo
            | LayerKind::Normal
            | LayerKind::Position
            | LayerKind::Depth => true,
        }
    }

    /// One line for each thing that the scene does not require, with what is left out because of it.
    pub fn left_out(&self) -> Vec<&'static str> {
        let facts = [
            (
                self.has_specular,
                "no light but through diffuse lobes: no specular layer, no specular network",
            ),
            (self.has_second_hit, "no second hit: no texture2 layer"),
            (self.has_emitters, "no emitter: no visibility layer, no shadow rays"),
            (self.has_masks, "no masks: shadow rays stop at the first surface"),
            (self.has_defocus, "a pinhole: no lens sampling"),
        ];
        facts.iter().filter(|(is_required, _)| !is_required).map(|&(_, line)| line).collect()
    }
}
