//! Rooms: boxes with windows, doors, furniture, and light from where rooms have it.

mod furnishing;
mod lamps;
mod shell;

use super::colour;
use super::error::Error;
use super::floor_plan::FloorPlan;
use super::form::{Form, Object, Role};
use super::lighting;
use super::material;
use super::random::Random;
use super::stage::{MaterialIndex, Stage};
use glam::{DVec2, DVec3};
use shell::{Opening, Wall};
use std::collections::BTreeMap;

/// What kind of room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// With tables, shelves, benches.
    Living,
    /// A small box, open at the front, with few things and coloured walls.
    Cabinet,
    /// Large, with columns, steps and a glossy floor.
    Hall,
    /// Tiled, with mirrors and glossy vessels.
    Bath,
}

/// Builds a room around the origin, its floor at `y = 0`.
///
/// # Errors
/// A file cannot be written.
pub(super) fn build(stage: &mut Stage, random: &mut Random) -> Result<(), Error> {
    stage.tag("room");
<<<<<<< HEAD
    let size =
        DVec3::new(random.uniform(2.6, 7.0), random.uniform(2.2, 3.8), random.uniform(2.6, 7.0));
    let mut room = Room {
        size,
        plan: FloorPlan::new(
            DVec2::new(-0.5 * size.x + 0.15, -0.5 * size.z + 0.15),
            DVec2::new(0.5 * size.x - 0.15, 0.5 * size.z - 0.15),
        ),
        wardrobe: BTreeMap::new(),
        is_lit: false,
        stage,
        random,
=======
    let kind = random.weighted(&[
        (0.54, Kind::Living),
        (0.2, Kind::Cabinet),
        (0.13, Kind::Hall),
        (0.13, Kind::Bath),
    ]);
    let (least, most) = match kind {
        Kind::Living => (DVec3::new(2.6, 2.2, 2.6), DVec3::new(7.0, 3.8, 7.0)),
        Kind::Cabinet => (DVec3::splat(1.2), DVec3::splat(2.8)),
        Kind::Hall => (DVec3::new(4.0, 3.0, 6.0), DVec3::new(9.0, 6.0, 14.0)),
        Kind::Bath => (DVec3::new(1.8, 2.2, 2.0), DVec3::new(3.5, 2.8, 4.5)),
>>>>>>> generator
    };
    let size = random.point(least, most);
    let inner = DVec2::new(0.5 * size.x, 0.5 * size.z) - 0.08;
    let plan = FloorPlan::new(-inner, inner);
    let mut room =
        Room { kind, size, plan, wardrobe: BTreeMap::new(), is_lit: false, stage, random };
    room.dress()?;
    room.shell()?;
    room.furnish()?;
    room.light()
}

struct Room<'a> {
    kind: Kind,
    size: DVec3,
    plan: FloorPlan,
    /// Materials of the shell, the same all around.
    wardrobe: BTreeMap<Role, MaterialIndex>,
    /// Is there light already, by a window or a door?
    is_lit: bool,
    stage: &'a mut Stage,
    random: &'a mut Random,
}

impl Room<'_> {
    /// Chooses what makes the kind of room out of walls and floor.
    fn dress(&mut self) -> Result<(), Error> {
        let (tag, dresses): (_, &[(Role, Role)]) = match self.kind {
            Kind::Living => ("living-room", &[]),
            Kind::Cabinet => ("cabinet", &[]),
            Kind::Hall => ("hall", &[(Role::Floor, Role::Polished)]),
            Kind::Bath => ("bath", &[(Role::Wall, Role::Tiled), (Role::Floor, Role::Tiled)]),
        };
        self.stage.tag(tag);
        for (role, dress) in dresses {
            let material = material::for_role(self.stage, *dress, self.random)?;
            self.wardrobe.insert(*role, material);
        }
        Ok(())
    }

    fn half(&self) -> DVec3 {
        DVec3::new(0.5 * self.size.x, self.size.y, 0.5 * self.size.z)
    }

    fn place(&mut self, object: &Object) -> Result<(), Error> {
        self.stage.place_with(object, self.random, &mut self.wardrobe)
    }

    /// Floor, ceiling and walls with their openings, and what is behind these.
    fn shell(&mut self) -> Result<(), Error> {
        let half = self.half();
        let flat = |y: f64, up: f64| Form::Mesh(shell::floor(half, y, up));
        self.place(&Object::of(Role::Floor, flat(0.0, 1.0)))?;
        self.place(&Object::of(Role::Ceiling, flat(self.size.y, -1.0)))?;
        // A room seen from outside, as a doll's house.
        let share = if self.kind == Kind::Cabinet { 0.85 } else { 0.15 };
        let is_open = self.random.chance(share);
        let camera_low = DVec3::new(-half.x + 0.15, 0.25, -half.z + 0.15);
        let mut camera_high = half - DVec3::new(0.15, 0.15, 0.15);
        let walls = Wall::around(self.size);
        let is_coloured = if self.kind == Kind::Cabinet {
            let both = self.random.chance(0.7);
            [false, both, false, both]
        } else {
            let accent = if self.random.chance(0.3) { self.random.integer(0, 3) } else { 4 };
            [0, 1, 2, 3].map(|side| side == accent)
        };
        for (index, wall) in walls.into_iter().enumerate() {
            if is_open && index == 0 {
                camera_high.z = half.z + 2.2 * self.size.x.max(self.size.z);
                self.stage.tag("open-front");
                continue;
            }
            let opening = self.opening(&wall);
            let mesh = wall.with_opening(opening.as_ref());
            let object = Object::of(Role::Wall, Form::Mesh(mesh));
            if is_coloured[index] {
                let object = object.recast(|_| true, Role::Coloured);
                self.stage.place(&object, self.random)?;
            } else {
                self.place(&object)?;
            }
            if let Some(opening) = opening {
                self.fill(&wall, &opening)?;
            }
            self.decorate(&wall, opening.is_some())?;
        }
        self.stage.camera_box = (camera_low, camera_high);
        if is_open && self.random.chance(0.3) {
            let radiance = self.random.log_uniform(0.05, 0.6);
            lighting::surround(self.stage, self.random, radiance)?;
            self.is_lit = true;
        }
        Ok(())
    }

    fn opening(&mut self, wall: &Wall) -> Option<Opening> {
        let (width, height) = (wall.width, self.size.y);
        let random = &mut *self.random;
<<<<<<< HEAD
        match random.integer(0, 9) {
            0..=2 => {
=======
        let windows = if self.kind == Kind::Cabinet { 0.06 } else { 0.27 };
        let doors = if width > 1.6 { 0.12 } else { 0.0 };
        match random.weighted(&[(windows, 0), (doors, 1), (1.0 - windows - doors, 2)]) {
            0 => {
>>>>>>> generator
                let (w, h) =
                    (random.uniform(0.25, 0.7) * width, random.uniform(0.35, 0.6) * height);
                let left = random.uniform(0.05 * width, 0.95 * width - w);
                let sill = random.uniform(0.15 * height, 0.9 * height - h);
                Some(Opening {
                    low: DVec2::new(left, sill),
                    high: DVec2::new(left + w, sill + h),
                    is_door: false,
                })
            }
            1 => {
                let (w, h) = (random.uniform(0.75, 1.0), 2.0_f64.min(0.9 * height));
                let left = random.uniform(0.1, width - w - 0.1);
                Some(Opening {
                    low: DVec2::new(left, 0.0),
                    high: DVec2::new(left + w, h),
                    is_door: true,
                })
            }
            _ => None,
        }
    }

    /// Panes and bars of a window and the sky outside; a door ajar and the lit room behind it.
    fn fill(&mut self, wall: &Wall, opening: &Opening) -> Result<(), Error> {
        if opening.is_door {
            let angle = self.random.uniform(0.15, 1.3);
            let door = wall.door(opening, angle);
            self.place(&Object::of(Role::Furniture, Form::Mesh(door)))?;
            let behind = wall.behind(opening, self.random.uniform(1.0, 2.2), self.size.y);
            self.place(&Object::of(Role::Wall, Form::Mesh(behind.shell)))?;
            self.stage.tag("door-ajar");
            if self.random.chance(0.75) {
                let radius = self.random.log_uniform(0.05, 0.25);
                let power = self.random.log_uniform(4.0, 40.0);
                self.bulb(behind.lamp, radius, power);
                self.stage.tag("hidden-light");
            }
            return Ok(());
        }
        self.stage.tag("window");
        if self.random.chance(0.35) {
            let mut pane = Object::default();
            pane.add(Role::Pane, wall.pane(opening));
            self.place(&pane)?;
        }
        let mut bars = Object::default();
        if self.random.chance(0.3) {
            bars.add_mesh(Role::Furniture, &wall.blinds(opening, self.random));
            self.stage.tag("blinds");
        } else {
            let counts = [self.random.integer(0, 3), self.random.integer(0, 3)];
            bars.add_mesh(Role::Furniture, &wall.bars(opening, counts));
        }
        self.place(&bars)?;
        if !self.is_lit {
            let radiance = self.random.log_uniform(1.0, 8.0);
            lighting::surround(self.stage, self.random, radiance)?;
            self.is_lit = true;
        }
        if self.random.chance(0.35) {
            let radiance = colour::light(self.random) * self.random.log_uniform(5.0, 40.0);
            self.stage.add_shining(wall.outside(opening, 0.8), radiance);
        }
        Ok(())
    }

    /// Pictures, a mirror, a wainscot.
    fn decorate(&mut self, wall: &Wall, has_opening: bool) -> Result<(), Error> {
        if self.random.chance(0.15) {
            let height = self.random.uniform(0.1, 1.2);
            if !has_opening {
                let object = Object::of(Role::Furniture, Form::Mesh(wall.panel(height, 0.02)));
                self.place(&object)?;
            }
        }
        let (pictures, mirrors) = match self.kind {
            Kind::Bath => (0.6, 0.8),
            Kind::Cabinet => (0.12, 0.3),
            Kind::Living | Kind::Hall => (0.5, 0.25),
        };
        if has_opening || !self.random.chance(pictures) {
            return Ok(());
        }
        let is_mirror = self.random.chance(mirrors);
        for k in 0..self.random.integer(1, 3) {
            let half = DVec2::new(self.random.uniform(0.2, 0.7), self.random.uniform(0.2, 0.6));
            let at = DVec2::new(
                self.random.uniform(0.15, 0.85) * wall.width,
                self.random.uniform(0.45, 0.65) * self.size.y,
            );
            let role = if is_mirror { Role::Mirror } else { Role::Picture(k as u8) };
            let object = Object::of(role, wall.picture(at, half));
            self.stage.place(&object, self.random)?;
        }
        Ok(())
    }
<<<<<<< HEAD

    fn furnish(&mut self) -> Result<(), Error> {
        for _ in 0..self.random.integer(0, 2) {
            self.table()?;
        }
        if self.random.chance(0.5) {
            self.against_wall()?;
        }
        if self.random.chance(0.2) {
            self.columns()?;
        }
        if self.random.chance(0.15) {
            let steps = self.random.integer(4, 9);
            let width = self.random.uniform(0.8, 1.6);
            let stairs = object::stairs(self.random, width, steps);
            self.stand(&stairs)?;
        }
        if self.random.chance(0.3) {
            let bench = object::bench(self.random);
            self.stand(&bench)?;
        }
        for _ in 0..self.random.integer(2, 7) {
            let size = self.random.log_uniform(0.2, 1.1);
            let thing = object::thing(self.random, size);
            self.stand(&thing)?;
        }
        Ok(())
    }

    /// Puts an object on a free place of the floor, if there is one, at a random angle of quarters.
    fn stand(&mut self, object: &Object) -> Result<Option<DVec3>, Error> {
        let (low, high) = object.bounds();
        let radius = 0.5 * (high - low).x.hypot((high - low).z);
        let Some(at) = self.plan.find(self.random, radius.min(0.9)) else { return Ok(None) };
        let quarter = std::f64::consts::FRAC_PI_2 * self.random.integer(0, 3) as f64;
        let at = DVec3::new(at.x, 0.0, at.y);
        let moved =
            object.transformed(&(DMat4::from_translation(at) * DMat4::from_rotation_y(quarter)));
        self.stage.place(&moved, self.random)?;
        self.stage.show(&moved);
        Ok(Some(at))
    }

    /// A table with things on it and chairs around it.
    fn table(&mut self) -> Result<(), Error> {
        let size = DVec3::new(
            self.random.uniform(0.7, 1.8),
            self.random.uniform(0.4, 0.95),
            self.random.uniform(0.5, 1.0),
        );
        let table = object::table(self.random, size);
        let Some(at) = self.stand(&table)? else { return Ok(()) };
        let reach = 0.5 * size.x.min(size.z);
        let mut plan = FloorPlan::new(
            DVec2::new(at.x - reach, at.z - reach),
            DVec2::new(at.x + reach, at.z + reach),
        );
        for _ in 0..self.random.integer(1, 6) {
            let size = self.random.log_uniform(0.08, 0.4);
            let thing = object::thing(self.random, size);
            if let Some(on) = plan.find(self.random, 0.5 * size) {
                let place = DMat4::from_translation(DVec3::new(on.x, size_top(&table), on.y));
                let moved = thing.transformed(&place);
                self.stage.place(&moved, self.random)?;
                self.stage.show(&moved);
            }
        }
        for _ in 0..self.random.integer(0, 2) {
            let chair = object::chair(self.random);
            self.stand(&chair)?;
        }
        Ok(())
    }

    fn against_wall(&mut self) -> Result<(), Error> {
        let shelf = object::shelf(self.random);
        let (low, high) = shelf.bounds();
        let (width, depth) = (high.x - low.x, high.z - low.z);
        let half = self.half();
        let is_side = self.random.chance(0.5);
        let limit = if is_side { half.z } else { half.x } - 0.5 * width;
        if limit <= 0.0 {
            return Ok(());
        }
        let along = self.random.uniform(-limit, limit);
        let back = 0.5 * depth + 0.02;
        let (at, turn) = if is_side {
            (DVec3::new(-half.x + back, 0.0, along), std::f64::consts::FRAC_PI_2)
        } else {
            (DVec3::new(along, 0.0, -half.z + back), 0.0)
        };
        let moved =
            shelf.transformed(&(DMat4::from_translation(at) * DMat4::from_rotation_y(turn)));
        self.plan.take(DVec2::new(at.x, at.z), 0.5 * width);
        self.stage.place(&moved, self.random)?;
        self.stage.show(&moved);
        Ok(())
    }

    fn columns(&mut self) -> Result<(), Error> {
        let radius = self.random.uniform(0.08, 0.22);
        let height = self.size.y;
        let mut object = Object::default();
        for _ in 0..self.random.integer(1, 4) {
            if let Some(at) = self.plan.find(self.random, radius) {
                let start = DVec3::new(at.x, 0.0, at.y);
                if self.random.chance(0.5) {
                    let end = start + DVec3::Y * height;
                    object.add(Role::Thing(0), Form::Cylinder { start, end, radius });
                } else {
                    let corner = DVec3::new(radius, 0.0, radius);
                    let top = start + corner + DVec3::Y * height;
                    object.add_mesh(Role::Furniture, &solid::cuboid(start - corner, top));
                }
            }
        }
        self.place(&object)
    }

    /// One to three kinds of lamps, fewer where light comes in already.
    fn light(&mut self) -> Result<(), Error> {
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
        let half = self.half();
        let top = self.size.y;
        let at = self.random.point(
            DVec3::new(-0.75 * half.x, 0.55 * top, -0.75 * half.z),
            DVec3::new(0.75 * half.x, 0.9 * top, 0.75 * half.z),
        );
        let ceiling = DVec3::new(at.x, top - 0.02, at.z);
        match self.random.integer(0, 9) {
            0..=2 => {
                let (u, v) = (self.random.log_uniform(0.1, 0.8), self.random.log_uniform(0.1, 0.8));
                let limit = DVec2::new(0.9 * half.x - at.x.abs(), 0.9 * half.z - at.z.abs());
                let (u, v) = (u.min(limit.x.max(0.05)), v.min(limit.y.max(0.05)));
                self.panel(ceiling, DVec3::X * u, DVec3::Z * v);
            }
            3 => {
                let length = self.random.uniform(0.3, 0.7) * half.x;
                let ceiling = DVec3::new(0.0, ceiling.y, ceiling.z);
                self.panel(ceiling, DVec3::X * length, DVec3::Z * 0.02);
                self.stage.tag("strip-light");
            }
            4 => {
                for _ in 0..self.random.integer(1, 4) {
                    let low = DVec3::new(-0.8 * half.x, 0.6 * top, -0.8 * half.z);
                    let high = DVec3::new(0.8 * half.x, 0.92 * top, 0.8 * half.z);
                    let at = self.random.point(low, high);
                    let radius = self.random.log_uniform(0.015, 0.2);
                    self.bulb(at, radius, 12.0);
                }
            }
            5 => {
                let size = self.random.uniform(0.12, 0.3);
                let shade = object::lampshade(self.random, size);
                let moved = shade.transformed(&DMat4::from_translation(at));
                self.stage.place(&moved, self.random)?;
                self.bulb(at, 0.04, 12.0);
            }
            6 => {
                let target = DVec3::new(-0.3 * at.x, 0.0, -0.3 * at.z);
                lighting::lamp(self.stage, self.random, at, target);
            }
            7 => {
                // A plate between lamp and room: only the ceiling and the wall are lit directly.
                let reach = self.random.uniform(0.2, 0.5);
                let plate =
                    Form::Rectangle { center: at, u: DVec3::Z * reach, v: DVec3::X * reach };
                self.place(&Object::of(Role::Furniture, plate))?;
                let above = at + DVec3::Y * 0.08;
                let radiance = colour::light(self.random) * 12.0 / (reach * reach);
                let (u, v) = (DVec3::Z * 0.6 * reach, DVec3::X * 0.6 * reach);
                self.stage.add_shining(Form::Rectangle { center: above, u, v }, radiance);
                self.stage.tag("hidden-light");
            }
            8 => {
                // Small lights of very different sizes in a row.
                for k in 0..4 {
                    let x = (f64::from(k) / 3.0 - 0.5) * 1.2 * half.x;
                    let radius = 0.01 * 2.2_f64.powi(k);
                    self.bulb(DVec3::new(x, 0.85 * top, -0.6 * half.z), radius, 4.0);
                }
                self.stage.tag("several-lights");
            }
            _ => {
                let wall = DVec3::new(at.x, 0.6 * top, -half.z + 0.03);
                let (u, v) = (self.random.uniform(0.1, 0.5), self.random.uniform(0.05, 0.4));
                let radiance = colour::light(self.random) * (4.0 / (u * v));
                let form = Form::Rectangle { center: wall, u: DVec3::X * u, v: DVec3::Y * v };
                self.stage.add_shining(form, radiance);
                self.stage.tag("area-light");
            }
        }
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

    fn bulb(&mut self, center: DVec3, radius: f64, power: f64) {
        let radiance = colour::light(self.random) * power / (4.0 * radius * radius * 10.0);
        self.stage.add_shining(Form::Sphere { center, radius }, radiance);
        self.stage.tag("sphere-light");
    }
}

/// Height of the top of an object.
fn size_top(object: &Object) -> f64 {
    object.bounds().1.y + 1e-3
=======
>>>>>>> generator
}
