//! Reads the golden cases and the paper's published transitions.
#![allow(dead_code, unreachable_pub, missing_docs)] // Each test takes what it needs.

use leg_plant::{Action, Apex, EARTH_GRAVITY_M_S2, Hop, Hopper, Leg, Medium};

pub const GOLDEN: &str = include_str!("../../../../tests/golden/apex_map.csv");

/// One row of a CSV file with its header.
pub struct Row<'a> {
    /// Line in the file, the header's being 1.
    pub line: usize,
    /// Names of the columns.
    pub header: &'a [&'a str],
    /// This row's values.
    pub cells: Vec<&'a str>,
}

impl Row<'_> {
    #[track_caller]
    pub fn cell(&self, name: &str) -> &str {
        let column = self.header.iter().position(|&h| h == name).unwrap();
        self.cells[column]
    }

    pub fn number(&self, name: &str) -> f64 {
        self.cell(name).parse().unwrap()
    }

    pub fn optional(&self, name: &str) -> Option<f64> {
        if !self.header.contains(&name) {
            return None;
        }
        let cell = self.cell(name);
        (!cell.is_empty()).then(|| cell.parse().unwrap())
    }
}

pub fn for_each_row(text: &str, mut visit: impl FnMut(&Row)) {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    for (i, line) in lines.enumerate() {
        visit(&Row { line: i + 2, header: &header, cells: line.split(',').collect() });
    }
}

/// One golden case.
pub struct Case {
    pub line: usize,
    pub leg: Leg,
    pub medium: Medium,
    pub start: Apex,
    pub action: Action,
}

impl Case {
    pub fn of(row: &Row) -> Self {
        let mut parameters = *Leg::human().parameters();
        if let Some(mass_kg) = row.optional("m") {
            parameters.mass_kg = mass_kg;
        }
        if let Some(stiffness_n_m) = row.optional("k") {
            parameters.stiffness_n_m = stiffness_n_m;
        }
        let gravity_m_s2 = row.optional("g").unwrap_or(EARTH_GRAVITY_M_S2);
        Self {
            line: row.line,
            leg: Leg::new(parameters).unwrap(),
            medium: Medium::new(row.number("rho"), gravity_m_s2).unwrap(),
            start: Apex { vx_m_s: row.number("vx"), y_m: row.number("y") },
            action: Action {
                touchdown_angle_rad: row.number("alpha"),
                elongation_speed_m_s: row.number("rs"),
            },
        }
    }

    pub fn hopper(&self) -> Hopper {
        Hopper::new(&self.leg, self.medium)
    }

    pub fn hop(&self) -> Hop {
        self.hopper().hop(self.start, self.action)
    }
}
