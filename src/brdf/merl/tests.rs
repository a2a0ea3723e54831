use super::*;
use std::f64::consts::PI;

/// Something that depends on all three angles.
struct Smooth;
impl Brdf for Smooth {
    fn evaluate(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        let angles = HalfDifference::from_directions(incoming, outgoing);
        let peak = angles.theta_h.cos().powi(40) * (1.0 + angles.theta_d.sin().powi(4));
        [0.2 + peak, 0.1 + 0.5 * peak, 0.3 + 0.1 * (2.0 * angles.phi_d).cos()]
    }
}

fn bytes_of(table: &MerlTable) -> Vec<u8> {
    let mut bytes = Vec::new();
    table.write_to(&mut bytes).unwrap();
    bytes
}

fn complaint(bytes: &[u8]) -> String {
    MerlTable::read_from(bytes, "x.binary").unwrap_err().to_string()
}

#[test]
fn a_table_is_written_and_read_and_looked_up() {
    let table = MerlTable::tabulate(&Smooth);
    let bytes = bytes_of(&table);
    assert_eq!(bytes.len(), 34_992_012);
    let again = MerlTable::read_from(bytes.as_slice(), "x.binary").unwrap();
    assert_eq!(bytes_of(&again), bytes);
    let grid = MerlGrid::new();
    let (mut count, mut worst) = (0, 0.0f64);
    for cell in table.valid_cells(&grid).step_by(101) {
        let (incoming, outgoing) = grid.directions_above(cell.index).unwrap();
        assert!((incoming[2] - cell.cos_incoming).abs() < 1e-12 && (outgoing[2] - cell.cos_outgoing).abs() < 1e-12);
        let (looked_up, smooth) =
            (again.evaluate(incoming, outgoing), again.interpolated().evaluate(incoming, outgoing));
        let exact = Smooth.evaluate(incoming, outgoing);
        for c in 0..3 {
            worst = worst.max((looked_up[c] - exact[c]).abs()).max((smooth[c] - exact[c]).abs());
        }
        count += 1;
    }
    assert!(count > 10_000 && worst < 1e-5, "{count} {worst}");
    // Between the middles, interpolation is much nearer than the cell.
    let (mut stepped, mut smooth) = (0.0f64, 0.0f64);
    for k in 0..2000 {
        let at = |step: f64| (k as f64 * step).fract();
        let angles = HalfDifference { theta_h: at(0.618) * 0.7, theta_d: at(0.755) * 0.7, phi_d: at(0.57) * PI };
        let (incoming, outgoing) = angles.directions();
        let exact = Smooth.evaluate(incoming, outgoing)[0];
        stepped = stepped.max((table.evaluate(incoming, outgoing)[0] - exact).abs());
        smooth = smooth.max((table.interpolated().evaluate(incoming, outgoing)[0] - exact).abs());
    }
    assert!(smooth < 1e-3 && stepped > 10.0 * smooth, "{stepped} {smooth}");
}

#[test]
fn damaged_files_are_named() {
    let bytes = bytes_of(&MerlTable::tabulate(&Smooth));
    for (length, word) in
        [(0, "has 0"), (11, "has 11"), (12, "byte 12 "), (70_001, "byte 70001 "), (34_992_011, "cut off")]
    {
        let said = complaint(&bytes[..length]);
        assert!(said.contains(word) && said.starts_with("x.binary: "), "{said}");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(complaint(&longer).contains("goes on"));
    let mut header = bytes.clone();
    header[..12].chunks_exact_mut(4).for_each(<[u8]>::reverse);
    assert!(complaint(&header).contains("big-endian"));
    let mut values = bytes.clone();
    values[12..].chunks_exact_mut(8).for_each(<[u8]>::reverse);
    let said = complaint(&values);
    assert!(said.contains("little-endian"), "{said}");
    let mut size = bytes.clone();
    size[4] = 91;
    assert!(complaint(&size).contains("90 x 91 x 180"));
    for (value, word) in [(f64::NAN, "not finite"), (-1.0, "no cell")] {
        let mut filled = bytes.clone();
        filled[12..].chunks_exact_mut(8).for_each(|bytes| bytes.copy_from_slice(&value.to_le_bytes()));
        assert!(complaint(&filled).contains(word));
    }
    // A few cells that are not numbers are cells that are not valid.
    let mut few = bytes;
    few[12..12 + 80].fill(0xff);
    let table = MerlTable::read_from(few.as_slice(), "x.binary").unwrap();
    assert!(table.cell(9).is_none() && table.cell(10).is_some());
}
