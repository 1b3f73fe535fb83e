//! The whole paths that a pair of walks was joined to.

use super::connect::Pair;
use super::path::{Event, Path};
use super::vertex::{LightVertex, Vertex};
use crate::emitter::LightPoint;

impl<'s> Pair<'_, 's> {
    /// The whole path of `s` light and `t` eye vertices, as a contribution names them; `None` where the walks have no such
    /// path, or one without light.
    pub fn path(&self, s: u32, t: u32) -> Option<Path<'s>> {
        if t == 0 {
            return self.path_through_lens(s as usize);
        }
        let (s, t) = (s as usize, t as usize);
        let (mut vertices, mut events) = (Vec::with_capacity(s + t), Vec::with_capacity(s + t));
        if s > 0 {
            vertices.push(Vertex::Light(self.start?));
            events.push(Event::Smooth);
            for step in self.light.steps.get(..s - 1)? {
                vertices.push(Vertex::Surface(step.surface.clone()));
                events.push(step.event);
            }
            // Connected here, whatever the walk went on to do.
            events[s - 1] = Event::Smooth;
        }
        let emitters = &self.scene.emitters;
        for index in (0..t.checked_sub(1)?).rev() {
            let is_last = index + 2 == t;
            let vertex = match self.eye.steps.get(index) {
                Some(step) if is_last && s == 0 => {
                    let id = step.surface.emitter?;
                    let point = emitters.surface_point(id, &step.surface.at);
                    Vertex::Light(LightVertex { id, point })
                }
                Some(step) => Vertex::Surface(step.surface.clone()),
                None => {
                    let direction = self.eye.escape?.direction;
                    let point = LightPoint::Infinite { direction, is_delta: false };
                    Vertex::Light(LightVertex { id: emitters.environment_id()?, point })
                }
            };
            vertices.push(vertex);
            events.push(match self.eye.steps.get(index) {
                Some(step) if !is_last => step.event,
                _ => Event::Smooth,
            });
        }
        let (raster, lens) = if t == 1 {
            let Vertex::Surface(surface) = vertices.last()? else { return None };
            (self.scene.camera.view(surface.at.position, self.lens)?.raster, self.lens)
        } else {
            (self.raster, self.lens)
        };
        let position = self.scene.camera.lens_point(lens);
        vertices.push(Vertex::Lens { raster, lens, position });
        events.push(Event::Smooth);
        Path::new(self.scene, vertices, events)
    }

    /// The path of `s` vertices of the walk from the light, the last of which is on the lens.
    fn path_through_lens(&self, s: usize) -> Option<Path<'s>> {
        let steps = self.light.steps.get(..s.checked_sub(2)?)?;
        let crossing = self.light.crossings.iter().find(|one| one.step + 1 == steps.len())?;
        let lens = Vertex::Lens {
            raster: crossing.view.raster,
            lens: crossing.lens,
            position: self.scene.camera.lens_point(crossing.lens),
        };
        let surfaces = steps.iter().map(|step| Vertex::Surface(step.surface.clone()));
        let vertices = std::iter::once(Vertex::Light(self.start?)).chain(surfaces).chain([lens]);
        let ends = [Event::Smooth];
        let events = ends.into_iter().chain(steps.iter().map(|step| step.event)).chain(ends);
        Path::new(self.scene, vertices.collect(), events.collect())
    }
}
