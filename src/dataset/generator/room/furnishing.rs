//! What stands in a room.

use super::{Kind, Room};
use crate::dataset::generator::error::Error;
use crate::dataset::generator::floor_plan::FloorPlan;
use crate::dataset::generator::form::{Form, Object, Role};
use crate::dataset::generator::{object, solid};
use glam::{DMat4, DVec2, DVec3};

impl Room<'_> {
    /// Tables with things on them, shelves, columns, steps, and things on the floor, as the kind of room has them.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(super) fn furnish(&mut self) -> Result<(), Error> {
        let small = self.size.x.min(self.size.z);
        let (tables, things, sizes) = match self.kind {
            Kind::Living => (self.random.integer(0, 2), self.random.integer(2, 7), [0.2, 1.1]),
            Kind::Cabinet => (0, self.random.integer(1, 4), [0.2 * small, 0.6 * small]),
            Kind::Hall => (self.random.integer(0, 1), self.random.integer(3, 8), [0.4, 1.8]),
            Kind::Bath => (self.random.integer(0, 1), self.random.integer(2, 5), [0.2, 0.8]),
        };
        for _ in 0..tables {
            self.table()?;
        }
        let chance = |room: &mut Self, living: f64, hall: f64| match room.kind {
            Kind::Living => room.random.chance(living),
            Kind::Hall => room.random.chance(hall),
            Kind::Cabinet | Kind::Bath => false,
        };
        if chance(self, 0.5, 0.2) {
            self.against_wall()?;
        }
        if chance(self, 0.2, 0.7) {
            self.columns()?;
        }
        if chance(self, 0.1, 0.6) {
            let width = self.random.uniform(0.8, 1.6);
            let steps = self.random.integer(4, 12);
            let stairs = object::stairs(self.random, width, steps);
            self.stand(&stairs)?;
        }
        if chance(self, 0.3, 0.2) {
            let bench = object::bench(self.random);
            self.stand(&bench)?;
        }
        if self.kind == Kind::Bath {
            let basin = object::basin(self.random);
            self.stand(&basin)?;
        }
        for _ in 0..things {
            let size = self.random.log_uniform(sizes[0], sizes[1]);
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
        // A hair above the floor: coinciding surfaces would both be seen through glass.
        let at = DVec3::new(at.x, 5e-4, at.y);
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
}

/// Height of the top of an object.
fn size_top(object: &Object) -> f64 {
    object.bounds().1.y + 1e-3
}
