namespace Terraport
{
    /// <summary>Hard bounds of every landing; null does not bound.</summary>
    public sealed class Budgets
    {
        /// <summary>Most triangles shown.</summary>
        public long? MaxTriangles { get; set; }

        /// <summary>Most payload bytes of what is shown.</summary>
        public long? MaxBytes { get; set; }

        /// <summary>Most segments shown.</summary>
        public long? MaxSegments { get; set; }
    }
}
