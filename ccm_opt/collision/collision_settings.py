"""Settings of distances and of the certificate between keyframes."""

from dataclasses import dataclass

from ccm_opt.jointed.jointed_settings import DEFAULT_LINK_MARGINS, LinkMarginSettings


@dataclass(frozen=True)
class CertificateSettings:
    """Numbers of the certificate.

    Attributes:
        depth: bisections of an interval before its certificate is refused. Taste: the sag falls four-fold at each.
        touch: gap that even an arm of no width keeps [arm lengths]. Derived: above what rounding takes in a room of up
            to a hundred thousand arm's lengths; where ``proof_rounding`` is more, that counts.
        rounding: depth of contact in these units, and bend beyond a joint limit [rad], that counts as none at an end of
            a motion. Derived: likewise.
        contact: depth below contact that motions of an arm with some width may have where they begin or end in
            contact, in these units. Derived: half of what the verifier allows; where the problem asks the verifier for
            more or less, half of that.
        contact_share: this half.
    """

    depth: int = 7
    touch: float = 1e-9
    rounding: float = 1e-9
    contact: float = 5e-7
    contact_share: float = 0.5


@dataclass(frozen=True)
class ContactSettings:
    """Numbers of the search for near pairs.

    Attributes:
        slack: of the neighbour list beyond the reach, as a multiple of it. Taste: a longer list is renewed less often.
        moved: share of that slack by which a coordinate of a joint may have moved before the list is renewed. Derived:
            below 1/√8, so that two joints together move by less than the slack.
        link_margins: of the margins between distant links.
    """

    slack: float = 1.5
    moved: float = 0.35
    link_margins: LinkMarginSettings = DEFAULT_LINK_MARGINS


DEFAULT_CERTIFICATE = CertificateSettings()
"""The numbers that are used unless others are given."""
DEFAULT_CONTACTS = ContactSettings()
"""Likewise."""
