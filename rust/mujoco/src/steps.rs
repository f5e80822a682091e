//! The table of a run: a column a figure, a row a step.

/// A column, ready to be handed over.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// Numbers; NaN stands for nothing where `nullable` says so.
    Float {
        /// A number a row.
        values: Vec<f64>,
        /// Whether NaN stands for nothing.
        nullable: bool,
    },
    /// Whole numbers; −1 stands for nothing.
    Int(Vec<i64>),
    /// Words: the different ones, and which of them each row has.
    Text {
        /// The different ones.
        words: Vec<&'static str>,
        /// A place among them a row.
        codes: Vec<u8>,
    },
    /// A list a row: all numbers one after another, and how many each row has.
    List {
        /// All numbers.
        values: Vec<f64>,
        /// Numbers of each row.
        lengths: Vec<usize>,
    },
}

/// Lists of numbers, one a row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lists {
    values: Vec<f64>,
    lengths: Vec<usize>,
}

impl Lists {
    /// Adds a row.
    pub fn push(&mut self, row: &[f64]) {
        self.values.extend_from_slice(row);
        self.lengths.push(row.len());
    }

    fn reserve(&mut self, rows: usize) {
        self.lengths.reserve(rows);
        self.values.reserve(rows * self.lengths.last().copied().unwrap_or(0));
    }

    fn truncate(&mut self, rows: usize) {
        while self.lengths.len() > rows {
            let entries = self.lengths.pop().unwrap_or(0);
            self.values.truncate(self.values.len() - entries);
        }
    }
}

/// Words of a few, one a row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Words {
    words: Vec<&'static str>,
    codes: Vec<u8>,
}

impl Words {
    /// Adds a row.
    ///
    /// # Panics
    /// If there are more than 256 different words.
    pub fn push(&mut self, word: &'static str) {
        let known = self.words.iter().position(|&other| other == word);
        let place = known.unwrap_or_else(|| {
            self.words.push(word);
            self.words.len() - 1
        });
        self.codes.push(u8::try_from(place).expect("columns of words have a few different ones"));
    }

    fn truncate(&mut self, rows: usize) {
        self.codes.truncate(rows);
    }

    fn reserve(&mut self, rows: usize) {
        self.codes.reserve(rows);
    }
}

macro_rules! steps {
    ($($(#[$doc:meta])* $name:ident: $kind:ty => $column:ident;)*) => {
        /// The rows of a run so far; a column that stays empty does not apply to it.
        #[derive(Debug, Clone, Default, PartialEq)]
        pub struct Steps {
            $($(#[$doc])* pub $name: $kind,)*
        }

        impl Steps {
            /// The columns that apply, by name, and nothing left behind.
            pub fn take(&mut self) -> Vec<(&'static str, Column)> {
                let mut columns = Vec::new();
                $($column(stringify!($name), std::mem::take(&mut self.$name), &mut columns);)*
                columns
            }

            /// Makes room for so many more rows, of as many numbers as the last one had.
            pub fn reserve(&mut self, rows: usize) {
                $(self.$name.reserve(rows);)*
            }

            /// Forgets the rows after so many: a step that failed half-way leaves none.
            pub fn truncate(&mut self, rows: usize) {
                $(self.$name.truncate(rows);)*
            }
        }
    };
}

type Columns = Vec<(&'static str, Column)>;

fn float(name: &'static str, values: Vec<f64>, columns: &mut Columns) {
    if !values.is_empty() {
        columns.push((name, Column::Float { values, nullable: false }));
    }
}

fn nullable(name: &'static str, values: Vec<f64>, columns: &mut Columns) {
    if !values.is_empty() {
        columns.push((name, Column::Float { values, nullable: true }));
    }
}

fn int(name: &'static str, values: Vec<i64>, columns: &mut Columns) {
    if !values.is_empty() {
        columns.push((name, Column::Int(values)));
    }
}

fn text(name: &'static str, words: Words, columns: &mut Columns) {
    if !words.codes.is_empty() {
        columns.push((name, Column::Text { words: words.words, codes: words.codes }));
    }
}

fn list(name: &'static str, lists: Lists, columns: &mut Columns) {
    if !lists.lengths.is_empty() {
        columns.push((name, Column::List { values: lists.values, lengths: lists.lengths }));
    }
}

steps! {
    /// Number of the step.
    step: Vec<i64> => int;
    /// s, at its start.
    time_s: Vec<f64> => float;
    /// How its solves ended.
    status: Words => text;
    /// Number of solves.
    solves: Vec<i64> => int;
    /// Those that did not converge.
    unconverged: Vec<i64> => int;
    /// Iterations of all solves.
    iterations: Vec<i64> => int;
    /// Of the one that took most.
    iterations_worst: Vec<i64> => int;
    /// Products of all solves.
    products: Vec<i64> => int;
    /// Recomputed pseudo-inverses.
    refreshes: Vec<i64> => int;
    /// New folds.
    refolds: Vec<i64> => int;
    /// Largest relative residual.
    residual_rel: Vec<f64> => float;
    /// Wall time of the solves.
    solve_ns: Vec<i64> => int;
    /// Rank of A.
    rank: Vec<i64> => int;
    /// ‖Nᵀ b‖.
    inconsistency: Vec<f64> => nullable;
    /// Of the first solve, relative.
    min_norm_error: Vec<f64> => float;
    /// From MuJoCo's acceleration, relative.
    qacc_rel_diff: Vec<f64> => float;
    /// From MuJoCo's constraint force, relative.
    qfrc_constraint_rel_diff: Vec<f64> => float;
    /// Largest deviation of a row, m or rad.
    drift_pos: Vec<f64> => float;
    /// Largest rate of a row.
    drift_vel: Vec<f64> => float;
    /// Largest acceleration of a row.
    drift_acc: Vec<f64> => float;
    /// How the projection ended.
    projection: Words => text;
    /// Its corrections of the positions.
    projection_rounds: Vec<i64> => int;
    /// Its solves.
    projection_solves: Vec<i64> => int;
    /// Their iterations.
    projection_iterations: Vec<i64> => int;
    /// Largest change of a coordinate, rad or m.
    projection_moved: Vec<f64> => float;
    /// Potential and kinetic energy, J.
    energy: Vec<f64> => float;
    /// Kinetic energy, J.
    kinetic_energy: Vec<f64> => float;
    /// From MuJoCo's trajectory, rad or m.
    trajectory_diff: Vec<f64> => nullable;
    /// Time of the step itself, µs.
    step_us: Vec<f64> => float;
    /// Positions, nq.
    qpos: Lists => list;
    /// Deviations, ne.
    residual: Lists => list;
    /// Multipliers, ne.
    multipliers: Lists => list;
    /// What an outside truth speaks of: a coordinate, or the place of a site.
    observed: Lists => list;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many rows, with a column of every kind.
    fn rows(count: i64) -> Steps {
        let mut steps = Steps::default();
        for step in 0..count {
            steps.step.push(step);
            steps.time_s.push(0.5 * step as f64);
            steps.inconsistency.push(f64::NAN);
            steps.status.push(if step == 1 { "breakdown" } else { "converged" });
            steps.multipliers.push(&[1.0, 2.0, 3.0][..=usize::try_from(step % 3).expect("small")]);
        }
        steps
    }

    #[test]
    fn columns_are_taken_by_name_with_nothing_left_behind() {
        let mut steps = rows(4);
        let columns = steps.take();
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["step", "time_s", "status", "inconsistency", "multipliers"]);
        assert_eq!(columns[0].1, Column::Int(vec![0, 1, 2, 3]));
        assert_eq!(columns[1].1, Column::Float { values: vec![0.0, 0.5, 1.0, 1.5], nullable: false });
        assert_eq!(
            columns[2].1,
            Column::Text { words: vec!["converged", "breakdown"], codes: vec![0, 1, 0, 0] }
        );
        assert!(matches!(&columns[3].1, Column::Float { values, nullable: true } if values.len() == 4));
        let values = vec![1.0, 1.0, 2.0, 1.0, 2.0, 3.0, 1.0];
        assert_eq!(columns[4].1, Column::List { values, lengths: vec![1, 2, 3, 1] });
        assert_eq!(steps, Steps::default());
        assert!(steps.take().is_empty());
    }

    #[test]
    fn a_row_that_was_begun_is_forgotten_in_every_column() {
        let mut steps = rows(3);
        steps.step.push(3);
        steps.status.push("converged");
        steps.multipliers.push(&[4.0]);
        steps.truncate(3);
        let shorter = |count: usize| {
            let mut steps = rows(3);
            steps.truncate(count);
            // NaN is not itself.
            steps.inconsistency.clear();
            steps
        };
        steps.inconsistency.clear();
        assert_eq!(steps, shorter(3));
        assert_eq!(shorter(2).multipliers, rows(2).multipliers);
        assert_eq!(shorter(0).multipliers, Lists::default());
    }

    #[test]
    fn room_is_no_row() {
        let mut steps = rows(2);
        steps.reserve(1000);
        assert!(steps.multipliers.values.capacity() >= 2000 && steps.step.capacity() >= 1000);
        assert_eq!(steps.take().len(), 5);
    }
}
