//! What lights a room.

use super::Room;
use crate::dataset::generator::error::Error;
use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::stage::Step;
use crate::dataset::generator::{colour, lighting, object, solid};
use glam::{DMat4, DVec2, DVec3};

impl Room<'_> {
    /// One to three kinds of lamps, fewer where light comes in already.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(super) fn light(&mut self) -> Result<(), Error> {
        let count =
            if self.is_lit && self.random.chance(0.5) { 0 } else { self.random.integer(1, 3) };
        if self.random.chance(0.08) {
            self.stage.tag("dark");
        }
        for _ in 0..count {
            self.lamp()?;
        }
        Ok(())
    }

    fn lamp(&mut self) -> Result<(), Error> {
        let lamps: [(f64, Step<Self>); 11] = [
            (3.0, Self::ceiling_panel),
            (1.0, Self::ceiling_strip),
            (1.0, Self::bulbs),
            (1.0, Self::shaded_bulb),
            (1.0, Self::beam),
            (1.0, Self::uplight),
            (1.0, Self::row),
            (1.0, Self::sconce),
            (1.0, Self::cove),
            (1.0, Self::partition),
            (1.0, Self::screen),
        ];
        self.random.weighted(&lamps)(self)
    }

    /// A place in the upper part of the room.
    fn above(&mut self) -> DVec3 {
        let half = self.half();
        let low = DVec3::new(-0.75 * half.x, 0.55 * half.y, -0.75 * half.z);
        self.random.point(low, DVec3::new(0.75 * half.x, 0.9 * half.y, 0.75 * half.z))
    }

    /// A rectangle in the ceiling, from a hand's breadth to most of it.
    fn ceiling_panel(&mut self) -> Result<(), Error> {
        let (half, at) = (self.half(), self.above());
        let (u, v) = (self.random.log_uniform(0.08, 1.6), self.random.log_uniform(0.08, 1.6));
        let limit = DVec2::new(0.9 * half.x - at.x.abs(), 0.9 * half.z - at.z.abs());
        let (u, v) = (u.min(limit.x.max(0.05)), v.min(limit.y.max(0.05)));
        let center = DVec3::new(at.x, half.y - 0.02, at.z);
        self.panel(center, DVec3::X * u, DVec3::Z * v);
        Ok(())
    }

    fn ceiling_strip(&mut self) -> Result<(), Error> {
        let (half, at) = (self.half(), self.above());
        let length = self.random.uniform(0.3, 0.7) * half.x;
        let center = DVec3::new(0.0, half.y - 0.02, at.z);
        self.panel(center, DVec3::X * length, DVec3::Z * 0.02);
        self.stage.tag("strip-light");
        Ok(())
    }

    fn bulbs(&mut self) -> Result<(), Error> {
        for _ in 0..self.random.integer(1, 4) {
            let at = self.above();
            let radius = self.random.log_uniform(0.015, 0.2);
            self.bulb(at, radius, 12.0);
        }
        Ok(())
    }

    /// A bulb in a shade.
    fn shaded_bulb(&mut self) -> Result<(), Error> {
        let at = self.above();
        let size = self.random.uniform(0.12, 0.3);
        let shade = object::lampshade(self.random, size);
        let moved = shade.transformed(&DMat4::from_translation(at));
        self.stage.place(&moved, self.random)?;
        self.bulb(at, 0.04, 12.0);
        Ok(())
    }

    /// A point or spot light.
    fn beam(&mut self) -> Result<(), Error> {
        let at = self.above();
        let target = DVec3::new(-0.3 * at.x, 0.0, -0.3 * at.z);
        lighting::lamp(self.stage, self.random, at, target);
        Ok(())
    }

    /// A lamp over a plate: only the ceiling and the upper walls are lit directly.
    fn uplight(&mut self) -> Result<(), Error> {
        let at = self.above();
        let reach = self.random.uniform(0.2, 0.5);
        let plate = Form::Rectangle { center: at, u: DVec3::Z * reach, v: DVec3::X * reach };
        self.place(&Object::of(Role::Furniture, plate))?;
        let center = at + DVec3::Y * 0.08;
        let radiance = colour::light(self.random) * 12.0 / (reach * reach);
        let (u, v) = (DVec3::Z * 0.6 * reach, DVec3::X * 0.6 * reach);
        self.stage.add_shining(Form::Rectangle { center, u, v }, radiance);
        self.stage.tag("hidden-light");
        Ok(())
    }

    /// Lights of equal power and very different size in a row.
    fn row(&mut self) -> Result<(), Error> {
        let half = self.half();
        for k in 0..4 {
            let x = (f64::from(k) / 3.0 - 0.5) * 1.2 * half.x;
            let radius = 0.01 * 2.2_f64.powi(k);
            self.bulb(DVec3::new(x, 0.85 * half.y, -0.6 * half.z), radius, 4.0);
        }
        self.stage.tag("several-lights");
        Ok(())
    }

    /// A rectangle on the back wall.
    fn sconce(&mut self) -> Result<(), Error> {
        let (half, at) = (self.half(), self.above());
        let center = DVec3::new(at.x, 0.6 * half.y, -half.z + 0.03);
        let (u, v) = (self.random.uniform(0.1, 0.5), self.random.uniform(0.05, 0.4));
        let radiance = colour::light(self.random) * (4.0 / (u * v));
        let form = Form::Rectangle { center, u: DVec3::X * u, v: DVec3::Y * v };
        self.stage.add_shining(form, radiance);
        self.stage.tag("area-light");
        Ok(())
    }

    /// A strip behind a fascia along the back wall, that lights the ceiling.
    fn cove(&mut self) -> Result<(), Error> {
        let half = self.half();
        let y = self.size.y * self.random.uniform(0.7, 0.88);
        let z = -half.z + 0.18;
        let board = solid::cuboid(DVec3::new(-half.x, y - 0.02, -half.z), DVec3::new(half.x, y, z));
        let lip = solid::cuboid(DVec3::new(-half.x, y, z - 0.02), DVec3::new(half.x, y + 0.1, z));
        let mut fascia = Object::default();
        fascia.add_mesh(Role::Furniture, &board);
        fascia.add_mesh(Role::Furniture, &lip);
        self.place(&fascia)?;
        let length = 0.95 * half.x;
        let radiance = colour::light(self.random) * 12.0 / (4.0 * length * 0.03);
        let center = DVec3::new(0.0, y + 0.01, -half.z + 0.08);
        // Facing up, for z × x points up.
        let form = Form::Rectangle { center, u: DVec3::Z * 0.03, v: DVec3::X * length };
        self.stage.add_shining(form, radiance);
        self.stage.tag("cove-light");
        self.stage.tag("hidden-light");
        Ok(())
    }

    /// A wall that reaches into the room, with a lamp behind it.
    fn partition(&mut self) -> Result<(), Error> {
        let half = self.half();
        let z = self.random.uniform(-0.7, -0.3) * half.z;
        let reach = self.random.uniform(0.5, 1.2) * half.x;
        let side = if self.random.chance(0.5) { 1.0 } else { -1.0 };
        let height = self.size.y * self.random.uniform(0.6, 0.999);
        let (a, b) = (side * half.x, side * (half.x - reach));
        let wall = solid::cuboid(
            DVec3::new(a.min(b), 0.0, z - 0.04),
            DVec3::new(a.max(b), height, z + 0.04),
        );
        self.place(&Object::of(Role::Wall, Form::Mesh(wall)))?;
        let behind = 0.5 * (z - half.z);
        let lamp = DVec3::new(side * (half.x - 0.35 * reach), 0.6 * height, behind);
        let radius = (0.25 * (z + half.z)).min(self.random.log_uniform(0.03, 0.15));
        self.bulb(lamp, radius.max(0.01), 25.0);
        self.stage.tag("hidden-light");
        Ok(())
    }

    /// A coloured panel that glows on a side wall: a screen or a sign.
    fn screen(&mut self) -> Result<(), Error> {
        let half = self.half();
        let side = if self.random.chance(0.5) { 1.0 } else { -1.0 };
        let center = DVec3::new(
            side * (half.x - 0.02),
            self.size.y * self.random.uniform(0.3, 0.7),
            half.z * self.random.uniform(-0.5, 0.5),
        );
        let (u, v) =
            (half.z * self.random.uniform(0.1, 0.4), self.size.y * self.random.uniform(0.08, 0.25));
        let hue = colour::hsv(self.random.unit(), self.random.uniform(0.2, 0.9), 1.0);
        // Facing inward: the normal of z × y is -x.
        let form = Form::Rectangle { center, u: DVec3::Z * (u * side), v: DVec3::Y * v };
        self.stage.add_shining(form, hue * (2.0 / (u * v)).min(40.0));
        self.stage.tag("screen");
        Ok(())
    }

    /// A rectangle that shines downward with a power of some watts per colour.
    fn panel(&mut self, center: DVec3, u: DVec3, v: DVec3) {
        let power = self.random.log_uniform(6.0, 30.0);
        let radiance = colour::light(self.random) * power / (4.0 * u.length() * v.length());
        // The normal, u × v, points down for x × z.
        self.stage.add_shining(Form::Rectangle { center, u, v }, radiance);
        self.stage.tag("area-light");
    }

    /// A sphere that shines with a power of about this many watts per colour.
    pub(super) fn bulb(&mut self, center: DVec3, radius: f64, power: f64) {
        let radiance = colour::light(self.random) * power / (4.0 * radius * radius * 10.0);
        self.stage.add_shining(Form::Sphere { center, radius }, radiance);
        self.stage.tag("sphere-light");
    }
}
