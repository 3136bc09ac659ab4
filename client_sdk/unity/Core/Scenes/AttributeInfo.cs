namespace Terraport
{
    /// <summary>One attribute of the survey, over the whole scene.</summary>
    public sealed class AttributeInfo
    {
        internal AttributeInfo(string name, double offset, double step, double? min, double? max)
        {
            Name = name;
            Offset = offset;
            Step = step;
            Min = min;
            Max = max;
        }

        /// <summary>The survey's own name.</summary>
        public string Name { get; private set; }

        /// <summary>Value of code 0: value = Offset + Step * code.</summary>
        public double Offset { get; private set; }

        /// <summary>Value of one code's step, above 0.</summary>
        public double Step { get; private set; }

        /// <summary>Lowest encoded value; null where there is none.</summary>
        public double? Min { get; private set; }

        /// <summary>Highest encoded value; null where there is none.</summary>
        public double? Max { get; private set; }
    }
}
