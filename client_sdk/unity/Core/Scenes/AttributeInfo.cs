namespace Terraport
{
    /// <summary>One attribute of the survey, over the whole scene.</summary>
    public sealed class AttributeInfo
    {
        internal AttributeInfo(string name, double? min, double? max)
        {
            Name = name;
            Min = min;
            Max = max;
        }

        /// <summary>The survey's own name.</summary>
        public string Name { get; private set; }

        /// <summary>Lowest encoded value; null where there is none.</summary>
        public double? Min { get; private set; }

        /// <summary>Highest encoded value; null where there is none.</summary>
        public double? Max { get; private set; }
    }
}
