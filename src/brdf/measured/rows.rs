//! Rows of a text table: names, cells, numbers.

use super::columns::ColumnLayout;
use crate::input::quoted;
use std::borrow::Cow;

/// Fault of a text with the number of its line, from 1.
pub(in crate::brdf) type LineFault = (usize, String);

/// Sign between the cells of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
enum CellSeparator {
    Sign(char),
    Whitespace,
}

/// A table of text whose first row names its columns.
#[derive(Debug)]
pub(in crate::brdf) struct TextTable<'a> {
    pub layout: ColumnLayout,
    /// Line of the names, from 1.
    pub names_line: usize,
    separator: CellSeparator,
    /// The text, and the number of its lines that come before the first row.
    text: &'a str,
    first_row: usize,
}

impl<'a> TextTable<'a> {
    /// Finds the names: in the first row, or, where that has numbers, in the last comment before it. Comments begin with #, % or //.
    /// # Errors
    /// Line and fault where there are no names, or a name is there twice.
    pub(in crate::brdf) fn new(text: &'a str) -> Result<Self, LineFault> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let (mut comment, mut stated) = (None, None);
        for (index, line) in lines(text).enumerate() {
            let line = line.trim();
            if let Some(sign) = line.strip_prefix("sep=").and_then(|rest| rest.chars().next()) {
                stated = Some(CellSeparator::Sign(sign));
                continue;
            }
            if let Some(words) = comment_of(line) {
                comment = Some((index, words));
                continue;
            }
            if line.is_empty() {
                continue;
            }
            let find = |line: &str| {
                let separator = stated.unwrap_or_else(|| separator_of(line));
                let cells = split(line, separator);
                ColumnLayout::from_names(cells.iter().map(|cell| &**cell)).map(|layout| (separator, layout))
            };
            let begins_with_number = split(line, separator_of(line)).first().is_some_and(|c| is_number(c));
            let (at, first_row) = if begins_with_number { (comment, index) } else { (Some((index, line)), index + 1) };
            let missing = || {
                let example = "theta_i,phi_i,theta_o,phi_o,r,g,b or wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,r,g,b";
                (index + 1, format!("the first row names the columns, such as {example}"))
            };
            let (names_at, names) = at.ok_or_else(missing)?;
            let (separator, layout) = find(names).map_err(|what| (names_at + 1, what))?;
            if begins_with_number && !layout.knows_some() {
                return Err(missing());
            }
            // A comment may name the columns with other signs between them than the rows have.
            let separator = if begins_with_number { separator_of(line) } else { separator };
            return Ok(TextTable { layout, names_line: names_at + 1, separator, text, first_row });
        }
        Err((1, "no row of names and no measurement".into()))
    }

    /// Cells of the rows, without comments and empty rows, with the numbers of their lines.
    pub(in crate::brdf) fn rows(&self) -> impl Iterator<Item = (usize, Vec<Cow<'a, str>>)> + '_ {
        let text: &'a str = self.text;
        let rows = lines(text).enumerate().skip(self.first_row);
        let rows = rows.filter(|(_, line)| !line.trim().is_empty() && comment_of(line.trim()).is_none());
        rows.map(|(index, line)| (index + 1, split(line.trim_matches([' ', '\r']), self.separator)))
    }

    /// Checks that a row has no more cells than there are names.
    pub(in crate::brdf) fn check_row(&self, cells: &[Cow<str>]) -> Result<(), String> {
        if cells.iter().skip(self.layout.count).all(|cell| cell.trim().is_empty()) {
            return Ok(());
        }
        let hint = match self.separator {
            CellSeparator::Sign(',') => "; where numbers have decimal commas, separate them by semicolons or tabs",
            _ => "",
        };
        Err(format!("{} cells, {} columns are named{hint}", cells.len(), self.layout.count))
    }
}

/// Lines that end with a line feed, with or without a carriage return, or with a carriage return alone.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    let end = if text.contains('\n') { '\n' } else { '\r' };
    text.split(end)
}

/// The words of a comment.
fn comment_of(line: &str) -> Option<&str> {
    ["#", "%", "//"]
        .iter()
        .find_map(|sign| line.strip_prefix(sign))
        .map(|rest| rest.trim_start_matches(['#', '%', '/']))
}

fn is_number(cell: &str) -> bool {
    let cell = cell.trim();
    cell.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && cell.replace(',', ".").parse::<f64>().is_ok()
}

fn separator_of(line: &str) -> CellSeparator {
    let mut quoted = false;
    let outside = |c: &char| {
        quoted ^= *c == '"';
        !quoted
    };
    let signs: String = line.chars().filter(outside).collect();
    let sign = ['\t', ';', ','].into_iter().find(|&sign| signs.contains(sign));
    sign.map_or(CellSeparator::Whitespace, CellSeparator::Sign)
}

/// Cells of a row; quotation marks around a cell are taken off.
fn split(line: &str, separator: CellSeparator) -> Vec<Cow<'_, str>> {
    let CellSeparator::Sign(sign) = separator else {
        return line.split_whitespace().map(|cell| Cow::Borrowed(cell.trim_matches('"'))).collect();
    };
    if !line.contains('"') {
        return line.split(sign).map(|cell| Cow::Borrowed(cell.trim())).collect();
    }
    let mut cells = vec![String::new()];
    let mut inside = false;
    for c in line.chars() {
        match c {
            '"' => inside = !inside,
            c if c == sign && !inside => cells.push(String::new()),
            c => cells.last_mut().into_iter().for_each(|cell| cell.push(c)),
        }
    }
    cells.into_iter().map(|cell| Cow::Owned(cell.trim().to_owned())).collect()
}

/// A number with what its last digit counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::brdf) struct WrittenNumber {
    pub value: f64,
    pub last_digit: f64,
}

/// Decimal sign of a file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum DecimalSign {
    #[default]
    Unknown,
    Point,
    Comma,
}

/// Reads the numbers of one file, which all have the same decimal sign.
#[derive(Debug, Default)]
pub(in crate::brdf) struct NumberReader {
    sign: DecimalSign,
    /// A number whose comma may as well set thousands apart, with its line, while no other says which.
    doubtful: Option<LineFault>,
}

impl NumberReader {
    /// Reads a cell; `None` where it says that there is no value.
    /// # Errors
    /// A sentence where it is no number, or its decimal sign is not that of the file.
    pub(in crate::brdf) fn read(&mut self, cell: &str, line: usize) -> Result<Option<WrittenNumber>, String> {
        let cell = cell.trim();
        let word = cell.to_ascii_lowercase();
        if ["", "-", "--", "---", "?", "nan", "na", "n/a", "null", "none", "missing"].contains(&word.as_str()) {
            return Ok(None);
        }
        let has_comma = cell.contains(',');
        if has_comma && cell.contains('.') || cell.matches(',').count() > 1 {
            return Err(format!("{}: write numbers without signs between thousands", quoted(cell)));
        }
        let sign = match (has_comma, cell.contains('.')) {
            (true, _) => DecimalSign::Comma,
            (_, true) => DecimalSign::Point,
            _ => self.sign,
        };
        if self.sign != DecimalSign::Unknown && sign != self.sign {
            return Err(format!("{}: decimal commas and decimal points in one file", quoted(cell)));
        }
        self.sign = sign;
        if has_comma {
            let (whole, rest) = cell.trim_start_matches(['+', '-']).split_once(',').unwrap_or((cell, ""));
            let thousands = whole.len() <= 3 && !whole.starts_with('0') && rest.len() == 3;
            match (thousands, &self.doubtful) {
                (true, None) => self.doubtful = Some((line, cell.to_owned())),
                (false, _) => self.doubtful = Some((0, String::new())),
                _ => {}
            }
        }
        let text = cell.replace(',', ".");
        // What begins with a letter is `inf`, which Rust reads as a number.
        let value = text.parse::<f64>().ok().filter(|x| x.is_finite());
        let value = value.ok_or_else(|| format!("{} is not a number", quoted(cell)))?;
        let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((&text, "0"));
        let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len().min(400)) as i32;
        let exponent = exponent.parse::<i32>().unwrap_or(0).clamp(-400, 400);
        Ok(Some(WrittenNumber { value, last_digit: 10f64.powi(exponent - decimals) }))
    }

    /// Checks, after the last number, that the decimal sign is beyond doubt.
    /// # Errors
    /// Line and fault of a number whose comma may be either.
    pub(in crate::brdf) fn finish(self) -> Result<(), LineFault> {
        match self.doubtful {
            Some((line, cell)) if line > 0 => Err((
                line,
                format!("{}: the comma may be a decimal sign or set thousands apart; write a point", quoted(&cell)),
            )),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_between_cells_are_found() {
        for text in [
            "\u{feff}theta_i,r\r\n1,2\r\n",
            "theta_i;r\r1;2",
            "sep=;\ntheta_i;r\n# no row\n\n1;2\n",
            "# made by hand\n# theta_i r\n1\t2\n",
            "\"theta_i\"\t\"r\"\n\"1\"\t2",
            "theta_i   r\n  1   2",
        ] {
            let table = TextTable::new(text).unwrap();
            assert!(table.layout.angles[0].is_some() && table.layout.colours[0] == Some(1), "{text}");
            let rows: Vec<_> = table.rows().map(|(_, cells)| cells.join("|")).collect();
            assert_eq!(rows, ["1|2"], "{text}");
        }
        assert!(TextTable::new("1,2\n").unwrap_err().1.contains("names the columns"));
        assert!(TextTable::new("# only a comment").is_err());
    }

    #[test]
    fn decimal_signs_are_of_one_kind() {
        let read = |cells: &[&str]| -> Result<Vec<Option<WrittenNumber>>, String> {
            let mut reader = NumberReader::default();
            let all = cells.iter().map(|cell| reader.read(cell, 7)).collect::<Result<_, _>>()?;
            reader.finish().map_err(|(line, what)| format!("{line} {what}"))?;
            Ok(all)
        };
        let number = |value, last_digit| Some(WrittenNumber { value, last_digit });
        assert_eq!(read(&["0,5", "1,234", "n/a"]).unwrap(), [number(0.5, 0.1), number(1.234, 0.001), None]);
        assert_eq!(read(&["1.5e-3", "-2"]).unwrap(), [number(0.0015, 1e-4), number(-2.0, 1.0)]);
        assert!(read(&["1,234"]).unwrap_err().starts_with("7 \"1,234\": the comma may be"));
        assert!(read(&["0,5", "0.5"]).unwrap_err().contains("commas and decimal points"));
        assert!(read(&["1,000.5"]).unwrap_err().contains("thousands"));
        assert!(read(&["inf"]).unwrap_err().contains("not a number"));
    }
}
