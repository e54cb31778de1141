"""Texts of URDF files: an arm of six joints, and what is done to it."""

LENGTHS_M = (0.16, 0.42, 0.39, 0.13, 0.10, 0.10)
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")


def link(name, collision=""):
    """Return a link of 1 kg."""
    return (
        f'<link name="{name}">\n'
        '  <inertial><mass value="1.0"/>\n'
        '    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>\n'
        f"  {collision}\n"
        "</link>\n"
    )


def joint(number, kind="revolute", more="", parent=None, limits='lower="-3" upper="3"'):
    """Return the joint that moves link ``number`` from the one before."""
    length_m = LENGTHS_M[number - 2] if number > 1 else 0.0
    before = parent or f"link_{number - 1}"
    return (
        f'<joint name="joint_{number}" type="{kind}">\n'
        f'  <parent link="{before}"/><child link="link_{number}"/>\n'
        f'  <origin xyz="0 0 {length_m}" rpy="0 0 0"/><axis xyz="{AXES[number - 1]}"/>\n'
        f'  <limit {limits} velocity="2.0" effort="100"/>{more}\n'
        "</joint>\n"
    )


FLANGE = (
    '<link name="flange"/>\n<joint name="mount" type="fixed">\n'
    '  <parent link="link_6"/><child link="flange"/><origin xyz="0 0 0.1"/>\n</joint>\n'
)
CAPSULE = (
    '<collision><origin xyz="0 0 0.1"/>'
    '<geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>'
)


def urdf(changed=None, more="", head='<?xml version="1.0"?>\n', collisions=None):
    """Return an arm.

    Parameters
    ----------
    changed
        Joints that are not as usual, by number.
    more
        Elements after all others.
    head
        What stands before the root.
    collisions
        Shapes of links, by number; else cylinders.
    """
    links = "".join(link(f"link_{n}", (collisions or {}).get(n, CAPSULE)) for n in range(7))
    joints = "".join((changed or {}).get(n, joint(n)) for n in range(1, 7))
    return f'{head}<robot name="six">\n{links}{joints}{FLANGE}{more}</robot>\n'


def urdf_of(arm):
    """Return the URDF of an arm, without shapes."""
    lines = [f'<robot name="{arm.name}">', '<link name="base"/>']
    before = "base"
    for item in arm.joints:
        body, frame = item.link, item.link.frame
        xx, yy, zz, xy, xz, yz = body.tensor_kg_m2
        # Where the source states the mass in another frame, through a fixed joint.
        lines += [
            f'<link name="{item.name}_link"/>',
            f'<link name="{item.name}_mass"><inertial><origin xyz="{_words(body.centre_m)}"/>',
            f'<mass value="{body.mass_kg!r}"/><inertia ixx="{xx!r}" iyy="{yy!r}" izz="{zz!r}"',
            f'ixy="{xy!r}" ixz="{xz!r}" iyz="{yz!r}"/></inertial></link>',
            f'<joint name="{item.name}_fixed" type="fixed"><parent link="{item.name}_link"/>',
            f'<child link="{item.name}_mass"/>{_origin(frame)}</joint>',
            f'<joint name="{item.name}" type="revolute"><parent link="{before}"/>',
            f'<child link="{item.name}_link"/>{_origin(item.placement)}',
            f'<axis xyz="{_words(item.axis)}"/><limit lower="{item.low_rad!r}"',
            f'upper="{item.high_rad!r}" velocity="{item.speed_rad_per_s!r}"',
            f'effort="{item.torque_nm!r}"/></joint>',
        ]
        before = f"{item.name}_link"
    lines += [
        f'<link name="flange"/><joint name="mount" type="fixed"><parent link="{before}"/>',
        f'<child link="flange"/>{_origin(arm.tip)}</joint></robot>',
    ]
    return "\n".join(lines)


def _origin(transform):
    return f'<origin xyz="{_words(transform.xyz_m)}" rpy="{_words(transform.rpy_rad)}"/>'


def _words(values):
    return " ".join(repr(value) for value in values)
