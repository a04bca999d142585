"""Materials of bodies, and the springs of a lattice made of them."""

import math
from dataclasses import dataclass

from .. import checks

# Stiffness of a connection inside the body divided by E·a (solid), E·t (sheet) or E·A/a (chain), by the number of
# axes it spans; the key is (number of axes, whether there are diagonals). Derived in the docstring of Material.
_STIFFNESS = {
    (1, False): (1.0,),
    (2, False): (1.0,),
    (2, True): (3 / 4, 3 / 8),
    (3, False): (1.0,),
    (3, True): (1 / 2, 3 / 10, 3 / 40),
}
_OVER_SHEAR = {2: 8 / 3, 3: 5 / 2}
"""Young's modulus divided by the shear modulus, of springs with diagonals, by number of axes."""
ROUNDING = 1e-12
"""If λ and μ differ by less than this fraction, they count as equal: springs alone have the ratio."""
LIGHTEST, DENSEST = 10.0, 30_000.0
"""Densities that are taken as meant [kg/m³]; osmium has 22 600."""
LARGEST_RATIO = 0.49
"""Largest Poisson's ratio: near 1/2 the resistance to compression grows without bound."""


@dataclass(frozen=True)
class Material:
    """An elastic, slightly damped material, which shapes convert to mass, stiffness and damping.

    Every whole cell of a lattice of spacing a contributes an eighth of its mass (a quarter in a sheet) to each of
    its corners, and part of the stiffness to each of its connections: a quarter to its edges, half to the
    diagonals of its faces (half and all in a sheet), all to its space diagonals. So connections in the body's
    faces and edges are softer than inside, a stretched bar is exact for any number of particles across, and the
    mass is density times volume. The constants of such a lattice differ within a direction, so its forces are
    gathered by a table instead of the stencil (see `msdwarp.kernels.springs`).

    **Stiffness.** Springs of stiffness k, length l and direction n have the energy of an elastic solid with
    C_ijkl = Σ k l² n_i n_j n_k n_l, summed over the springs in a unit of volume (Born and Huang, Dynamical Theory
    of Crystal Lattices, 1954; Ostoja-Starzewski, Lattice models in micromechanics, Appl. Mech. Rev. 55 (2002)
    35-60). With k₁ along axes, k₂ along face and k₃ along space diagonals inside the body:

    - *Solid, 26 neighbours*: C11 = (k₁ + 2 k₂ + 4/3 k₃)/a and C12 = C44 = (k₂ + 4/3 k₃)/a. It is isotropic if
      C11 − C12 = 2 C44, so k₁ = k₂ + 8/3 k₃; then E = 5/2 C44. One parameter remains, s = 4/3 k₃ / (k₂ + 4/3 k₃).
      Compression waves of wave number q are too slow by (q a)²/24, times 1 along an axis, 3/2 along a face
      diagonal and (11 + 10 s)/9 along a space diagonal: up to s = 1/4 no direction is worse than at s = 0. Shear
      waves become more alike in all directions as s grows to about 1/3. Hence s = 1/4: k₁ = 1/2 E a,
      k₂ = 3/10 E a, k₃ = 3/40 E a. At s = 1 a cell could be deformed without any resistance.
    - *Sheet of thickness t, 8 neighbours*: C11 t = k₁ + k₂ and C12 t = C66 t = k₂. It is isotropic if k₁ = 2 k₂;
      then in plane stress E t = 8/3 k₂: k₁ = 3/4 E t, k₂ = 3/8 E t. Nothing resists bending out of its
      plane, unless the argument `bending` of `sheet` is given.
    - *6 or 4 neighbours*: k₁ = E a or E t. The modulus is exact along the axes; nothing resists shear.
    - *Chain of cross section A*: k₁ = E A / a.

    **Poisson's ratio.** Springs alone give C12 = C44, Cauchy's relation: Poisson's ratio is 1/4 in a solid, 1/3 in
    a sheet and 0 without diagonals. For another ratio ν springs give only the shear modulus μ = E/(2 (1 + ν)):
    their constants are for a modulus 5/2 μ in a solid, 8/3 μ in a sheet. Each cell adds κ = λ − μ to Lamé's λ as a
    resistance to volume change (`Cells`), with λ = E ν/((1 + ν)(1 − 2 ν)) in a solid, and of area in a sheet, with
    λ = E ν/(1 − ν²) of plane stress. Homogeneous strain remains exact. κ grows without bound near 1/2, and
    shortens the step: for a block it is half the step of springs alone at 0.45, a quarter at 0.49. Below the ratio
    of springs κ is negative, and a body compressed or stretched by a third may stay distorted. The modulus and the
    ratio are correct for small strains; at 10 % the ratio (of logarithmic strains) is within 0.02.

    **Error.** Homogeneous strain is exact. A bar n cells high resists bending too much: by 5/(4 n²) of E I in a
    sheet, and by at most 11/(10 n²) in a solid: four cells are 8 and 7 % too stiff. N cells long, the frequency
    of its slowest longitudinal mode is too low by at most π²/(24 N²).

    **Damping.** Every connection has b = β k with β = 2 ζ/ω₁, where ω₁ = π c/L and c = √(E/ρ): ζ is the damping
    ratio of the slowest longitudinal mode of a free bar as long as the body, whatever the spacing. L is the
    body's longest extent along an axis. A mode of frequency ω has the damping ratio ζ ω/ω₁. Cells have c = β κ,
    at most β μ: above ν = 1/3 their dampers would shorten the step ever more, although volumes hardly change. For
    the same ζ a solid's β is then larger by 1/(1 − φ), at most 1.03, with the fraction φ = (κ − μ)(1 − 2 ν)²/E =
    (3 ν − 1)(1 − 2 ν)/(1 + ν) of a stretched bar's energy without a damper; and so is the damping of shear.

    Parameters
    ----------
    density
        ρ [kg/m³].
    youngs_modulus
        E [Pa].
    damping_ratio
        ζ; at 1 the slowest longitudinal mode is critically damped. For small damping it is half the loss factor η.
    poissons_ratio
        ν, from 0 to 0.49; by default the ratio of springs alone, which costs least. It has no effect on a chain.

    Warns
    -----
    UnitWarning
        If the density is below 10 or above 30 000 kg/m³, as 1.2 for g/cm³ would be.
    """

    density: float
    youngs_modulus: float
    damping_ratio: float = 0.0
    poissons_ratio: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "density", checks.positive("density", self.density))
        if not LIGHTEST <= self.density <= DENSEST:
            solids = f"solids have {LIGHTEST:g} to {DENSEST:g} kg/m³"
            checks.warn(f"density is {self.density:g} kg/m³; {solids}, and 1 g/cm³ is 1000", checks.UnitWarning)
        object.__setattr__(self, "youngs_modulus", checks.positive("youngs_modulus", self.youngs_modulus))
        object.__setattr__(self, "damping_ratio", checks.non_negative("damping_ratio", self.damping_ratio))
        if self.poissons_ratio is not None:
            try:
                ratio = checks.between("poissons_ratio", self.poissons_ratio, 0.0, LARGEST_RATIO)
            except ValueError as error:
                raise ValueError(f"{error}; nearer to 1/2 the stable step is too short") from None
            object.__setattr__(self, "poissons_ratio", ratio)

    @property
    def wave_speed(self) -> float:
        """Speed c = √(E/ρ) of long compression waves in a thin bar [m/s]."""
        return math.sqrt(self.youngs_modulus / self.density)

    def cell_mass(self, axes: int, spacing: float, section: float = 1.0) -> float:
        """Return the mass of a cell in a lattice with this number of axes [kg].

        The section is the cross section of a chain [m²], the thickness of a sheet [m], or 1.
        """
        return self.density * section * spacing**axes

    def cell_stiffness(
        self, axes: int, spacing: float, section: float = 1.0, *, diagonals: bool
    ) -> tuple[float, ...]:
        """Return the stiffness of inner connections [N/m], by the number of axes they span, from 1 on."""
        unit = self._modulus_of_springs(axes) * section * spacing ** (axes - 2)
        return tuple(unit * fraction for fraction in _STIFFNESS[axes, diagonals])

    def cell_modulus(self, axes: int, section: float = 1.0) -> float:
        """Return κ = λ − μ of the cells of a solid [Pa] or sheet [N/m]; 0 if springs alone give the ratio."""
        nu = self.poissons_ratio
        if nu is None or axes == 1:
            return 0.0
        lame = nu / ((1 + nu) * (1 - 2 * nu)) if axes == 3 else nu / (1 - nu**2)
        shear = 1 / (2 * (1 + nu))
        return self.youngs_modulus * section * (lame - shear) if abs(lame - shear) > ROUNDING * shear else 0.0

    def _modulus_of_springs(self, axes: int) -> float:
        """Return Young's modulus of a lattice of springs with the shear modulus of the material [Pa]."""
        if self.poissons_ratio is None or axes == 1:
            return self.youngs_modulus
        return _OVER_SHEAR[axes] * self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    def flexural_rigidity(self, thickness: float, *, diagonals: bool = True) -> float:
        """Return D = E t³ / (12 (1 − ν²)) of a sheet [N m].

        ν is the material's Poisson's ratio, by default the ratio of springs: 1/3, or 0 without diagonals.
        """
        poisson = self.poissons_ratio
        if poisson is None:
            poisson = 1 / 3 if diagonals else 0.0
        return self.youngs_modulus * thickness**3 / (12 * (1 - poisson**2))

    def damped_modulus(self, axes: int, section: float = 1.0) -> float:
        """Return c/β of cells, κ or at most the shear modulus, of a solid [Pa] or sheet [N/m]."""
        shear = self._modulus_of_springs(axes) * section / _OVER_SHEAR.get(axes, 1.0)
        return min(self.cell_modulus(axes, section), shear)

    def damping_time(self, length: float, axes: int = 1) -> float:
        """Return β = b/k for a body of this length with this number of axes [s]."""
        nu = 0.0 if self.poissons_ratio is None or axes < 3 else self.poissons_ratio
        undamped = max(0.0, (3 * nu - 1) * (1 - 2 * nu) / (1 + nu))
        return 2 * self.damping_ratio * length / (math.pi * self.wave_speed) / (1 - undamped)


# Values are midpoints of the quoted ranges; damping ratios are half the loss factor, which depends on frequency,
# temperature and amplitude. Ashby: Materials Selection in Mechanical Design, appendix A. The volume of rubber and
# gels hardly changes: their Poisson's ratios are above 0.499, but the step becomes too short there. At 0.45, too,
# what is crushed does not turn inside out (docs/limits.md).

RUBBER = Material(density=925.0, youngs_modulus=2.0e6, damping_ratio=0.03, poissons_ratio=0.45)
"""Natural rubber without filler."""
# Density 920-930, E 1.5-2.5 MPa (Ashby). Loss factor 0.02-0.10 (Gent, Engineering with Rubber).

JELLY = Material(density=1000.0, youngs_modulus=12.5e3, damping_ratio=0.05, poissons_ratio=0.45)
"""Gel of 5 % gelatin in water, with the density of water."""
# Shear modulus G = 4.18 ± 0.84 kPa (Nguyen et al., Ultrasound in Medicine and Biology 40 (2014) 168-176), and E is
# 3 G as its volume hardly changes. Loss factor of a soft gel 0.06-0.14 at 20-200 Hz (Okamoto, Clayton and Bayly,
# Physics in Medicine and Biology 56 (2011) 6379).

FOAM = Material(density=54.0, youngs_modulus=2.0e6, damping_ratio=0.05)
"""Flexible polymer foam of low density, as in cushions."""
# Density 38-70, E 1-3 MPa (Ashby). Loss factor of the order of 0.1 (Ashby's chart of loss coefficients).

COTTON = Material(density=324.0, youngs_modulus=0.61e6, damping_ratio=0.04)
"""Woven cotton, as a sheet 1 mm thick: denim."""
# 0.324 kg/m²; 205 N/m along the weft and 1014 N/m along the warp, of which this is the mean ("11oz black denim" in
# the data of Wang, O'Brien and Ramamoorthi, Data-driven elastic models for cloth, ACM Trans. Graph. 30 (2011) 71).
# Denims are 0.8-1.2 mm thick and give back 48-66 % of the work of stretching, one 54 %: ζ = (1 − 0.54)/(4π)
# (Kumari and Khurana, Journal of Textiles 2016, 4614168, table 5).

STEEL_WIRE = Material(density=7850.0, youngs_modulus=210e9, damping_ratio=1e-4)
"""Steel with much carbon, as in springs and wire ropes."""

CORK = Material(density=170.0, youngs_modulus=15e6, damping_ratio=0.1, poissons_ratio=0.1)
"""Cork as an isotropic material: means over the three axes."""
# Density 170, E 20 MPa along the trunk's radius and 13 MPa across; Poisson's ratio 0.05-0.1 if the radius is one
# of the two directions, else 0.25-0.5 (Gibson, Easterling and Ashby, The structure and mechanics of cork, Proc.
# R. Soc. A 377 (1981) 99-117). Loss factor 0.1-0.3 (Ashby's chart of loss coefficients).

SILICONE = Material(density=1070.0, youngs_modulus=118e3, damping_ratio=0.05, poissons_ratio=0.49)
"""Soft platinum-cured silicone (Ecoflex 00-30). Almost incompressible, so the step is short."""
# Density 1070, and 10 psi at 100 % elongation (Smooth-On, technical bulletin of the Ecoflex series). A neo-Hookean
# solid has the stress G (λ − 1/λ²) there: 69 kPa at λ = 2 is G = 39 kPa, E = 3 G. The loss factor, 0.1, is typical
# of a soft rubber (Ashby's chart).

MUSCLE = Material(density=1060.0, youngs_modulus=62e3, damping_ratio=0.1, poissons_ratio=0.45)
"""Relaxed muscle as an isotropic material, for small loads. Damping and Poisson's ratio are assumed."""
# Density 1.0597 (Mendez and Keys, Metabolism 9 (1960) 184-188). E = 62.2 ± 10.3 kPa, of gluteal muscle of young
# men pressed by 5 N; by 30 N it is seven times as stiff (Isogai et al., J. Phys. Ther. Sci. 34 (2022) 777-783).
