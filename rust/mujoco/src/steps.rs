//! The table of a run: a column a figure, a row a step. A column is begun by whoever first writes into it.

/// A column, ready to be handed over.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// Numbers.
    Float {
        /// A number a row.
        values: Vec<f64>,
        /// Whether NaN stands for nothing.
        nullable: bool,
    },
    /// Whole numbers.
    Int {
        /// A number a row.
        values: Vec<i64>,
        /// Whether [`NOTHING`] stands for nothing.
        nullable: bool,
    },
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

/// Stands for nothing among whole numbers that may be missing: no count is negative.
pub const NOTHING: i64 = -1;

impl Column {
    /// Rows of it.
    #[must_use]
    pub const fn len(&self) -> usize {
        match self {
            Self::Float { values, .. } => values.len(),
            Self::Int { values, .. } => values.len(),
            Self::Text { codes, .. } => codes.len(),
            Self::List { lengths, .. } => lengths.len(),
        }
    }

    /// Whether it has none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn reserve(&mut self, rows: usize) {
        match self {
            Self::Float { values, .. } => values.reserve(rows),
            Self::Int { values, .. } => values.reserve(rows),
            Self::Text { codes, .. } => codes.reserve(rows),
            Self::List { values, lengths } => {
                lengths.reserve(rows);
                values.reserve(rows * lengths.last().copied().unwrap_or(0));
            }
        }
    }

    fn truncate(&mut self, rows: usize) {
        match self {
            Self::Float { values, .. } => values.truncate(rows),
            Self::Int { values, .. } => values.truncate(rows),
            Self::Text { codes, .. } => codes.truncate(rows),
            Self::List { values, lengths } => {
                while lengths.len() > rows {
                    let entries = lengths.pop().unwrap_or(0);
                    values.truncate(values.len() - entries);
                }
            }
        }
    }
}

/// The rows of a run so far. Every row writes the same columns, once each; a column that nobody writes does not apply.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Steps {
    columns: Vec<(&'static str, Column)>,
    /// Rows write their columns in the same order: here the next one is found without a search.
    next: usize,
}

macro_rules! writers {
    ($($(#[$doc:meta])* $name:ident($value:ident: $kind:ty) into $column:pat, begun as $empty:expr => $push:expr;)*) => {
        impl Steps {
            $(
                $(#[$doc])*
                ///
                /// # Panics
                /// If the column holds something else.
                pub fn $name(&mut self, name: &'static str, $value: $kind) {
                    match self.column(name, || $empty) {
                        $column => $push,
                        other => unreachable!("column {name} holds {other:?}"),
                    }
                }
            )*
        }
    };
}

writers! {
    /// Writes a number into a column.
    float(value: f64) into Column::Float { values, nullable: false },
        begun as Column::Float { values: Vec::new(), nullable: false } => values.push(value);
    /// Writes a number, or nothing.
    maybe(value: Option<f64>) into Column::Float { values, nullable: true },
        begun as Column::Float { values: Vec::new(), nullable: true } => values.push(value.unwrap_or(f64::NAN));
    /// Writes a whole number.
    int(value: i64) into Column::Int { values, nullable: false },
        begun as Column::Int { values: Vec::new(), nullable: false } => values.push(value);
    /// Writes a size, or nothing.
    maybe_size(value: Option<usize>) into Column::Int { values, nullable: true },
        begun as Column::Int { values: Vec::new(), nullable: true } =>
        values.push(value.map_or(NOTHING, |size| i64::try_from(size).unwrap_or(i64::MAX)));
    /// Writes one of a few words: not more than 256 different ones.
    word(value: &'static str) into Column::Text { words, codes },
        begun as Column::Text { words: Vec::new(), codes: Vec::new() } => {
        let known = words.iter().position(|&other| other == value);
        let place = known.unwrap_or_else(|| {
            words.push(value);
            words.len() - 1
        });
        codes.push(u8::try_from(place).expect("columns of words have a few different ones"));
    };
    /// Writes a list of numbers.
    list(value: &[f64]) into Column::List { values, lengths },
        begun as Column::List { values: Vec::new(), lengths: Vec::new() } => {
        values.extend_from_slice(value);
        lengths.push(value.len());
    };
}

impl Steps {
    fn column(&mut self, name: &'static str, empty: impl FnOnce() -> Column) -> &mut Column {
        // The same place in memory, as a rule: reading the names costs more than writing the number.
        let same = |other: &'static str| std::ptr::eq(other, name) || other == name;
        let here = self.columns.get(self.next).is_some_and(|(other, _)| same(other));
        let at = if here {
            self.next
        } else {
            self.columns.iter().position(|(other, _)| *other == name).unwrap_or_else(|| {
                self.columns.push((name, empty()));
                self.columns.len() - 1
            })
        };
        self.next = if at + 1 < self.columns.len() { at + 1 } else { 0 };
        &mut self.columns[at].1
    }

    /// The columns that apply, by name, and nothing left behind.
    pub fn take(&mut self) -> Vec<(&'static str, Column)> {
        self.next = 0;
        let mut columns = std::mem::take(&mut self.columns);
        columns.retain(|(_, column)| !column.is_empty());
        columns
    }

    /// Makes room for so many more rows, of as many numbers as the last one had.
    pub fn reserve(&mut self, rows: usize) {
        for (_, column) in &mut self.columns {
            column.reserve(rows);
        }
    }

    /// Forgets the rows after so many: a step that failed half-way leaves none.
    pub fn truncate(&mut self, rows: usize) {
        for (_, column) in &mut self.columns {
            column.truncate(rows);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(steps: &mut Steps, step: i64) {
        steps.int("step", step);
        steps.float("time_s", 0.5 * step as f64);
        steps.word("status", if step == 1 { "breakdown" } else { "converged" });
        steps.maybe("inconsistency", (step > 0).then_some(0.5));
        steps.maybe_size("rank", (step > 0).then_some(4));
        steps.list("multipliers", &[1.0, 2.0, 3.0][..=usize::try_from(step % 3).expect("small")]);
    }

    /// So many rows, with a column of every kind.
    fn rows(count: i64) -> Steps {
        let mut steps = Steps::default();
        (0..count).for_each(|step| row(&mut steps, step));
        steps
    }

    #[test]
    fn columns_are_taken_by_name_with_nothing_left_behind() {
        let mut steps = rows(4);
        let columns = steps.take();
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["step", "time_s", "status", "inconsistency", "rank", "multipliers"]);
        assert_eq!(columns[0].1, Column::Int { values: vec![0, 1, 2, 3], nullable: false });
        assert_eq!(columns[1].1, Column::Float { values: vec![0.0, 0.5, 1.0, 1.5], nullable: false });
        assert_eq!(
            columns[2].1,
            Column::Text { words: vec!["converged", "breakdown"], codes: vec![0, 1, 0, 0] }
        );
        assert!(matches!(&columns[3].1, Column::Float { values, nullable: true } if values[0].is_nan()));
        assert_eq!(columns[4].1, Column::Int { values: vec![NOTHING, 4, 4, 4], nullable: true });
        let values = vec![1.0, 1.0, 2.0, 1.0, 2.0, 3.0, 1.0];
        assert_eq!(columns[5].1, Column::List { values, lengths: vec![1, 2, 3, 1] });
        assert_eq!(steps, Steps::default());
        assert!(steps.take().is_empty());
    }

    #[test]
    fn a_row_that_was_begun_is_forgotten_in_every_column() {
        let mut steps = rows(3);
        steps.int("step", 3);
        steps.word("status", "converged");
        steps.list("multipliers", &[4.0]);
        for count in [3, 2, 1] {
            steps.truncate(count);
            let expected = rows(i64::try_from(count).expect("few")).take();
            for ((name, column), (other, expected)) in steps.clone().take().into_iter().zip(expected) {
                assert_eq!((name, column.len()), (other, count));
                // NaN is not itself, and words that no row has any more stay known.
                if !matches!(name, "inconsistency" | "status") {
                    assert_eq!(column, expected, "{name}");
                }
            }
        }
        steps.truncate(0);
        assert!(steps.take().is_empty());
    }

    #[test]
    fn rows_go_on_after_the_table_was_taken() {
        let mut steps = rows(1);
        steps.take();
        row(&mut steps, 1);
        let taken = steps.take();
        assert_eq!(taken[0].1, Column::Int { values: vec![1], nullable: false });
        assert_eq!(taken[2].1, Column::Text { words: vec!["breakdown"], codes: vec![0] });
    }

    #[test]
    fn rows_may_write_in_another_order() {
        let mut steps = Steps::default();
        for names in [["a", "b"], ["b", "a"], ["a", "b"]] {
            for name in names {
                steps.float(name, if name == "a" { 1.0 } else { 2.0 });
            }
        }
        let column = |value: f64| Column::Float { values: vec![value; 3], nullable: false };
        assert_eq!(steps.take(), [("a", column(1.0)), ("b", column(2.0))]);
    }

    #[test]
    fn room_is_no_row() {
        let mut steps = rows(2);
        steps.reserve(1000);
        let room =
            |name: &str| steps.columns.iter().find(|(other, _)| *other == name).map(|(_, column)| column);
        assert!(matches!(room("step"), Some(Column::Int { values, .. }) if values.capacity() >= 1000));
        assert!(
            matches!(room("multipliers"), Some(Column::List { values, .. }) if values.capacity() >= 2000)
        );
        assert_eq!(steps.take().len(), 6);
    }

    #[test]
    #[should_panic(expected = "column step holds Float")]
    fn a_column_holds_one_kind() {
        let mut steps = Steps::default();
        steps.float("step", 1.0);
        steps.int("step", 1);
    }
}
