namespace Terraport
{
    /// <summary>
    /// Two pieces that are united at a cost: regions by their id, or R + m for what union m made, R being the regions' number.
    /// </summary>
    public struct RegionUnion
    {
        /// <summary>The piece with the lower number.</summary>
        public int One;

        /// <summary>The other.</summary>
        public int Other;

        /// <summary>What it costs, from 1.</summary>
        public double Cost;
    }
}
