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
        let windows = if self.kind == Kind::Cabinet { 0.06 } else { 0.27 };
        let doors = if width > 1.6 { 0.12 } else { 0.0 };
        match random.weighted(&[(windows, 0), (doors, 1), (1.0 - windows - doors, 2)]) {
            0 => {
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
}
