namespace Terraport
{
    /// <summary>What a single landing may ask for; null leaves it to the server.</summary>
    public sealed class LandOptions
    {
        /// <summary>
        /// Beyond the radius everything up to here comes at its coarser level, where the scene has one; metres, at least the radius, and
        /// cut to what the server allows. A <see cref="SceneStage"/> asks for one by itself.
        /// </summary>
        public double? CoarseRadiusM { get; set; }

        /// <summary>Radius of the inner part that may be shown when the deadline passes, metres.</summary>
        public double? InnerRadiusM { get; set; }

        /// <summary>When the inner part may be shown before the rest, milliseconds after the command.</summary>
        public int? DeadlineMs { get; set; }

        /// <summary>How long nothing may come before the landing counts as stalled, milliseconds.</summary>
        public int? StallMs { get; set; }

        internal LandOptions Copy() { return (LandOptions)MemberwiseClone(); }
    }
}
