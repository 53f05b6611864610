//! Tables of contents: what there is to log and to set, told one entry at a time.

use kestrel_core::crc32::Crc32;

use super::packet::Packet;

/// Channel of tables, on the ports of both.
pub const CHANNEL: u8 = 0;

/// Request of one entry.
const ITEM: u8 = 2;

/// Request of the number of entries and their checksum.
const SUMMARY: u8 = 3;

/// What stands in a table.
pub trait Listed {
    /// Name of its group, ASCII.
    fn group(&self) -> &'static str;

    /// Its name in the group, ASCII; both together have at most 24 bytes.
    fn name(&self) -> &'static str;

    /// Its type, in the code of its table.
    fn code(&self) -> u8;
}

/// Answers a request for `table`; `limits` ends the summary.
pub fn answer<T: Listed>(request: &Packet, table: &[T], limits: &[u8]) -> Option<Packet> {
    let mut fields = request.fields();
    let command = fields.byte()?;
    let reply = request.reply().with(&[command]);
    match command {
        SUMMARY => {
            let reply = reply.with(&(table.len() as u16).to_le_bytes()).with(&checksum(table).to_le_bytes());
            Some(reply.with(limits))
        }
        ITEM => {
            let index = fields.short()?;
            let Some(entry) = table.get(usize::from(index)) else { return Some(reply) };
            let reply = reply.with(&index.to_le_bytes()).with(&[entry.code()]);
            Some(reply.with(entry.group().as_bytes()).with(&[0]).with(entry.name().as_bytes()).with(&[0]))
        }
        _ => None,
    }
}

/// Changes whenever any entry does: clients keep the tables that they know under this number.
pub fn checksum<T: Listed>(table: &[T]) -> u32 {
    let mut sum = Crc32::new();
    for entry in table {
        let texts = entry.group().bytes().chain([0]).chain(entry.name().bytes());
        texts.chain([0, entry.code()]).for_each(|byte| sum.add(byte));
    }
    sum.value()
}

/// Whether `group` and `name` are those of an entry.
pub fn is_called(entry: &impl Listed, group: &[u8], name: &[u8]) -> bool {
    entry.group().as_bytes() == group && entry.name().as_bytes() == name
}

/// What every table must satisfy.
#[cfg(test)]
pub(super) fn check<T: Listed>(table: &[T]) {
    let mut names = std::collections::BTreeSet::new();
    for entry in table {
        let (group, name) = (entry.group(), entry.name());
        assert!(group.is_ascii() && name.is_ascii() && !group.is_empty() && !name.is_empty());
        assert!(group.len() + name.len() <= 24, "{group}.{name} does not fit a packet");
        assert!(names.insert((group, name)), "{group}.{name} twice");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crtp::packet::Port;

    struct Thing(&'static str, u8);

    impl Listed for Thing {
        fn group(&self) -> &'static str {
            "group"
        }

        fn name(&self) -> &'static str {
            self.0
        }

        fn code(&self) -> u8 {
            self.1
        }
    }

    const THINGS: [Thing; 2] = [Thing("one", 7), Thing("two", 8)];

    fn ask(data: &[u8]) -> Option<Vec<u8>> {
        let request = Packet::new(Port::Log, CHANNEL).with(data);
        answer(&request, &THINGS, &[16, 128]).map(|reply| reply.data().to_vec())
    }

    #[test]
    fn the_summary_counts_and_sums() {
        let [a, b, c, d] = checksum(&THINGS).to_le_bytes();
        assert_eq!(ask(&[3]), Some(vec![3, 2, 0, a, b, c, d, 16, 128]));
    }

    #[test]
    fn an_entry_has_its_index_type_group_and_name() {
        assert_eq!(ask(&[2, 1, 0]), Some(b"\x02\x01\x00\x08group\0two\0".to_vec()));
    }

    #[test]
    fn an_entry_that_does_not_exist_has_no_content() {
        assert_eq!(ask(&[2, 2, 0]), Some(vec![2]));
        assert_eq!(ask(&[2, 0xFF, 0xFF]), Some(vec![2]));
    }

    #[test]
    fn requests_of_other_versions_and_short_ones_are_not_answered() {
        for data in [&[][..], &[0, 0], &[1], &[2], &[2, 0], &[9]] {
            assert_eq!(ask(data), None, "{data:?}");
        }
    }

    #[test]
    fn the_checksum_sees_every_part_of_every_entry() {
        let sum = checksum(&THINGS);
        assert_ne!(checksum(&THINGS[..1]), sum);
        assert_ne!(checksum(&[Thing("one", 7), Thing("twp", 8)]), sum);
        assert_ne!(checksum(&[Thing("one", 7), Thing("two", 7)]), sum);
    }
}
