//! Sets that are joined, as a forest of parents: the root of a set is its first member (Tarjan 1975).

/// The root of the set that `member` is in.
pub(crate) fn root(parents: &mut [usize], mut member: usize) -> usize {
    while parents[member] != member {
        parents[member] = parents[parents[member]];
        member = parents[member];
    }
    member
}

/// Joins the sets of two members.
pub(crate) fn join(parents: &mut [usize], member: usize, other: usize) {
    let (member, other) = (root(parents, member), root(parents, other));
    let (first, second) = (member.min(other), member.max(other));
    parents[second] = first;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_joined_by_way_of_others_has_one_root() {
        let mut parents: Vec<usize> = (0..7).collect();
        for (member, other) in [(4, 5), (2, 6), (5, 2), (1, 3)] {
            join(&mut parents, member, other);
        }
        let roots: Vec<_> = (0..7).map(|member| root(&mut parents, member)).collect();
        assert_eq!(roots, [0, 1, 2, 1, 2, 2, 2]);
    }
}
