//! Sets without walls all around: grounds, backdrops, terraces, pedestals, plates.

use super::colour;
use super::error::Error;
use super::floor_plan::FloorPlan;
use super::form::{Form, Object, Role};
use super::lighting;
use super::noise::Noise;
use super::object;
use super::random::Random;
use super::solid;
use super::stage::{Stage, Step};
use glam::{DMat4, DVec2, DVec3};

/// Builds an open set around the origin, its ground at about `y = 0`.
///
/// # Errors
/// A file cannot be written.
pub(super) fn build(stage: &mut Stage, random: &mut Random) -> Result<(), Error> {
    stage.tag("open");
    let radius = random.log_uniform(0.8, 4.0);
    let mut set = Set { radius, stage, random };
    set.stage.camera_box =
        (DVec3::new(-8.0 * radius, 0.04 * radius, -8.0 * radius), DVec3::splat(8.0 * radius));
    set.build()?;
    set.light()
}

struct Set<'a> {
    /// Of the part with things on it, metres.
    radius: f64,
    stage: &'a mut Stage,
    random: &'a mut Random,
}

impl Set<'_> {
    fn build(&mut self) -> Result<(), Error> {
        let builds: [(f64, Step<Self>); 8] = [
            (4.0, Self::ground),
            (2.0, Self::backdrop),
            (2.0, Self::terrace),
            (1.0, Self::terrain),
            (1.0, Self::plates),
            (1.0, Self::pool),
            (1.2, Self::glassware),
            (2.3, Self::table_top),
        ];
        self.random.weighted(&builds)(self)
    }

    /// A floor of this half-extent.
    fn floor(&mut self, half: f64) -> Result<(), Error> {
        let mesh = solid::sheet(1, 2.0 * half, |_, _| 0.0);
        let mesh = mesh.transformed(&DMat4::from_scale(DVec3::new(half, 1.0, half)));
        self.stage.place(&Object::of(Role::Floor, Form::Mesh(mesh)), self.random)
    }

    /// Things that stand apart from each other at height `y`.
    fn things(&mut self, y: f64, count: usize) -> Result<(), Error> {
        let extent = DVec2::splat(self.radius);
        let mut plan = FloorPlan::new(-extent, extent);
        for index in 0..count {
            let largest = if index == 0 { 0.9 } else { 0.6 };
            let size = self.radius * self.random.log_uniform(0.12, largest);
            let thing = object::thing(self.random, size);
            if let Some(at) = plan.find(self.random, 0.55 * size) {
                let at = DVec3::new(at.x, y, at.y);
                self.put(&thing, at)?;
            }
        }
        Ok(())
    }

    /// Puts an object down, a hair above what it stands on: coinciding surfaces would both be seen through glass.
    fn put(&mut self, object: &Object, at: DVec3) -> Result<(), Error> {
        let place = at + DVec3::Y * (1e-3 * self.radius);
        let moved = object.transformed(&DMat4::from_translation(place));
        self.stage.place(&moved, self.random)?;
        self.stage.show(&moved);
        Ok(())
    }

    fn ground(&mut self) -> Result<(), Error> {
        let half = self.radius * self.random.log_uniform(2.0, 15.0);
        self.floor(half)?;
        let count = self.random.integer(3, 14);
        self.things(0.0, count)
    }

    /// A sweep: floor that curves up into a wall, as in a studio.
    fn backdrop(&mut self) -> Result<(), Error> {
        let (r, width) = (self.radius, 4.0 * self.radius);
        let bend = r * self.random.uniform(0.3, 1.0);
        let mut profile = vec![DVec2::new(4.0 * r, 0.0)];
        for k in 0..=16 {
            let angle = std::f64::consts::FRAC_PI_2 * f64::from(k) / 16.0;
            profile.push(DVec2::new(-1.3 * r - bend * angle.sin(), bend * (1.0 - angle.cos())));
        }
        profile.push(DVec2::new(-1.3 * r - bend, 5.0 * r));
        let last = profile.len() - 1;
        let mesh = super::mesh::Mesh::grid(1, last, |u, v| {
            let p = profile[(v * last as f64).round() as usize];
            (
                DVec3::new((2.0 * u - 1.0) * width, p.y, p.x),
                DVec2::new(u * 2.0 * width, v * 9.0 * r),
            )
        });
        let role = if self.random.chance(0.6) { Role::Wall } else { Role::Floor };
        self.stage.place(&Object::of(role, Form::Mesh(mesh)), self.random)?;
        self.stage.tag("backdrop");
        let count = self.random.integer(2, 9);
        self.things(0.0, count)
    }

    /// A platform with steps, columns and a parapet.
    fn terrace(&mut self) -> Result<(), Error> {
        self.floor(6.0 * self.radius)?;
        let r = self.radius;
        let height = r * self.random.uniform(0.05, 0.4);
        let mut object = Object::default();
        for step in 0..3 {
            let share = 1.0 - 0.3333 * f64::from(step);
            let half = r * (1.2 + 0.25 * (1.0 - share) * 3.0);
            let low = DVec3::new(-half, 0.0, -half);
            object
                .add_mesh(Role::Floor, &solid::cuboid(low, DVec3::new(half, height * share, half)));
        }
        self.stage.place(&object, self.random)?;
        let count = self.random.integer(2, 6);
        let (thick, tall) = (r * self.random.uniform(0.04, 0.1), r * self.random.uniform(0.8, 2.0));
        let mut columns = Object::default();
        for k in 0..count {
            let x = r * 1.1 * (2.0 * k as f64 / (count - 1) as f64 - 1.0);
            let start = DVec3::new(x, height, -1.1 * r);
            let end = start + DVec3::Y * tall;
            columns.add(Role::Thing(0), Form::Cylinder { start, end, radius: thick });
        }
        let beam = DVec3::new(-1.25 * r, height + tall, -1.1 * r - 1.5 * thick);
        let size = DVec3::new(2.5 * r, 2.0 * thick, 3.0 * thick);
        columns.add_mesh(Role::Furniture, &solid::cuboid(beam, beam + size));
        self.stage.place(&columns, self.random)?;
        self.stage.show(&columns);
        self.stage.tag("terrace");
        let count = self.random.integer(4, 14);
        self.things(height, count)
    }

    /// Hills with things on pedestals.
    fn terrain(&mut self) -> Result<(), Error> {
        let noise = Noise::new(self.random.seed());
        let (half, height) = (6.0 * self.radius, self.radius * self.random.uniform(0.1, 0.7));
        let scale = self.random.uniform(1.0, 5.0);
        let mesh = solid::sheet(120, 2.0 * half, |x, z| {
            height * noise.space_octaves(DVec3::new(x, 0.0, z) * scale, 5)
        });
        let mesh = mesh.transformed(&DMat4::from_scale(DVec3::new(half, 1.0, half)));
        self.stage.place(&Object::of(Role::Floor, Form::Mesh(mesh)), self.random)?;
        self.stage.tag("terrain");
        for _ in 0..self.random.integer(1, 4) {
            let r = self.radius;
            let at = self.random.point(DVec3::new(-r, -height, -r), DVec3::new(r, -height, r));
            let pedestal = object::pedestal(self.random, 2.0 * height + 0.2 * r);
            let (low, high) = pedestal.bounds();
            self.stage.place(&pedestal.transformed(&DMat4::from_translation(at)), self.random)?;
            let size = self.random.uniform(0.7, 1.2) * (high.x - low.x);
            let thing = object::thing(self.random, size);
            self.put(&thing, at + DVec3::Y * high.y)?;
        }
        Ok(())
    }

    /// Glossy plates leaning behind each other under lights of very different size.
    fn plates(&mut self) -> Result<(), Error> {
        self.floor(5.0 * self.radius)?;
        let r = self.radius;
        for k in 0..self.random.integer(2, 5) {
            let step = f64::from(k as u32);
            let lean = -1.4 + 0.3 * step + self.random.uniform(-0.08, 0.08);
            let center = DVec3::new(0.0, r * (0.1 + 0.17 * step), r * (0.8 - 0.5 * step));
            let turn = DMat4::from_rotation_x(lean);
            let u = DVec3::X * r;
            let v = turn.transform_vector3(DVec3::Y) * 0.23 * r;
            let plate = Object::of(Role::Plate(k as u8), Form::Rectangle { center, u, v });
            self.stage.place(&plate, self.random)?;
            self.stage.show(&plate);
        }
        for k in 0..self.random.integer(3, 6) {
            let radius = r * 0.008 * 2.3_f64.powi(k as i32);
            let x = r * self.random.uniform(-0.9, 0.9);
            let center = DVec3::new(x, 1.1 * r, -r);
            let radiance = colour::light(self.random) * (0.3 * r * r / (radius * radius));
            self.stage.add_shining(Form::Sphere { center, radius }, radiance);
        }
        self.stage.tag("plates");
        self.stage.tag("several-lights");
        let count = self.random.integer(0, 2);
        self.things(0.0, count)
    }

    /// A basin with water in it, over tiles, and things on the bottom and beside it.
    fn pool(&mut self) -> Result<(), Error> {
        let (r, depth) = (self.radius, self.radius * self.random.uniform(0.2, 0.8));
        let (inner, outer) = (r, r * self.random.uniform(1.3, 4.0));
        let (low, rim) = (-depth - 0.1 * r, 0.08 * r);
        let mut basin = Object::default();
        let box_of = |low: [f64; 3], high: [f64; 3]| solid::cuboid(low.into(), high.into());
        for (low, high) in [
            ([-outer, low, -outer], [outer, rim, -inner]),
            ([-outer, low, inner], [outer, rim, outer]),
            ([-outer, low, -inner], [-inner, rim, inner]),
            ([inner, low, -inner], [outer, rim, inner]),
        ] {
            basin.add_mesh(Role::Tiled, &box_of(low, high));
        }
        // From above, where the water is seen over the rim.
        self.stage.camera_box.0.y = 0.4 * r;
        let bottom = box_of([-inner, low, -inner], [inner, -depth, inner]);
        basin.add_mesh(Role::Tiled, &bottom);
        self.stage.place(&basin, self.random)?;
        let noise = Noise::new(self.random.seed());
        let (scale, height) = (self.random.uniform(2.0, 8.0), self.random.log_uniform(0.002, 0.03));
        let water = solid::sheet(100, 1.0, |x, z| {
            height * noise.space_octaves(DVec3::new(x, 0.3, z) * scale, 3)
        });
        // The rim of the sheet is inside the walls.
        let stretch = DMat4::from_scale(DVec3::new(1.02 * inner, r, 1.02 * inner));
        let water = Object::of(Role::Water, Form::Mesh(water.transformed(&stretch)));
        self.stage.place(&water, self.random)?;
        self.stage.show(&water);
        self.stage.tag("caustic");
        self.stage.tag("pool");
        let count = self.random.integer(0, 4);
        self.things(-depth, count)?;
        if self.random.chance(0.7) {
            let radius = r * self.random.log_uniform(0.04, 0.3);
            let center =
                r * self.random.point(DVec3::new(-1.0, 1.5, -1.0), DVec3::new(1.0, 3.0, 1.0));
            let radiance = colour::light(self.random) * (2.0 * r * r / (radius * radius));
            self.stage.add_shining(Form::Sphere { center, radius }, radiance);
            self.stage.tag("sphere-light");
        }
        Ok(())
    }

    /// Glass things on a pale ground under a small strong light.
    fn glassware(&mut self) -> Result<(), Error> {
        self.floor(6.0 * self.radius)?;
        let r = self.radius;
        let mut plan = FloorPlan::new(DVec2::splat(-r), DVec2::splat(r));
        for _ in 0..self.random.integer(1, 5) {
            let size = r * self.random.log_uniform(0.3, 1.0);
            let mut thing = object::thing(self.random, size);
            if self.random.chance(0.7) {
                thing = thing.recast(|role| role == Role::Thing(0), Role::Glass);
            }
            if let Some(at) = plan.find(self.random, 0.55 * size) {
                self.put(&thing, DVec3::new(at.x, 0.0, at.y))?;
            }
        }
        let mut direction = self.random.direction();
        direction.y = direction.y.abs() + 0.5;
        let center = direction.normalize() * r * self.random.uniform(2.0, 4.0);
        let radius = r * self.random.log_uniform(0.03, 0.2);
        let radiance = colour::light(self.random) * (4.0 * r * r / (radius * radius));
        self.stage.add_shining(Form::Sphere { center, radius }, radiance);
        self.stage.tag("caustic");
        self.stage.tag("sphere-light");
        Ok(())
    }

    /// A table top full of things, seen close.
    fn table_top(&mut self) -> Result<(), Error> {
        let r = self.radius;
        let size = DVec3::new(2.4 * r, 1.2 * r, 2.4 * r);
        let table = object::table(self.random, size);
        let down = DMat4::from_translation(DVec3::NEG_Y * 1.2 * r);
        self.stage.place(&table.transformed(&down), self.random)?;
        if self.random.chance(0.7) {
            let far = 3.0 * r;
            let low = DVec3::new(-far, -1.2 * r, -far);
            let corner = solid::cuboid(low - 0.1 * r, DVec3::new(far, -1.2 * r, far));
            let wall = solid::cuboid(low - 0.1 * r, DVec3::new(far, 3.0 * r, -far));
            self.stage.place(&Object::of(Role::Floor, Form::Mesh(corner)), self.random)?;
            self.stage.place(&Object::of(Role::Wall, Form::Mesh(wall)), self.random)?;
        }
        self.stage.tag("still-life");
        let count = self.random.integer(4, 12);
        self.things(0.0, count)
    }

    fn light(&mut self) -> Result<(), Error> {
        let has_surround = self.random.chance(0.8);
        if has_surround {
            let radiance = self.random.log_uniform(0.1, 1.0);
            lighting::surround(self.stage, self.random, radiance)?;
        }
        let lamps = match (has_surround, self.random.chance(0.4)) {
            (false, _) => self.random.integer(1, 4),
            (true, true) => self.random.integer(1, 2),
            (true, false) => 0,
        };
        for _ in 0..lamps {
            self.lamp();
        }
        Ok(())
    }

    /// A rectangle, sphere, point, spot or parallel light above, aimed at the middle.
    fn lamp(&mut self) {
        let r = self.radius;
        let mut direction = self.random.direction();
        direction.y = direction.y.abs() + 0.3;
        let at = direction.normalize() * r * self.random.uniform(1.5, 3.5);
        let power = self.random.log_uniform(0.5, 4.0) * at.length_squared();
        match self.random.integer(0, 5) {
            0..=2 => {
                let normal = -at.normalize();
                let (u, v) = normal.any_orthonormal_pair();
                let (a, b) = (
                    r * self.random.log_uniform(0.03, 1.2),
                    r * self.random.log_uniform(0.03, 1.2),
                );
                let radiance = colour::light(self.random) * power / (4.0 * a * b);
                self.stage
                    .add_shining(Form::Rectangle { center: at, u: u * a, v: v * b }, radiance);
                self.stage.tag("area-light");
            }
            3 => {
                let radius = r * self.random.log_uniform(0.02, 0.4);
                let radiance = colour::light(self.random) * power / (3.0 * radius * radius);
                self.stage.add_shining(Form::Sphere { center: at, radius }, radiance);
                self.stage.tag("sphere-light");
            }
            4 => lighting::lamp(self.stage, self.random, at, DVec3::ZERO),
            _ => lighting::directional(self.stage, self.random),
        }
    }
}
