namespace Terraport.Unity
{
    /// <summary>What sort of device the bounds are for.</summary>
    public enum DeviceProfile
    {
        /// <summary>Chosen at run time: a mobile device in XR is a headset, another one a phone, everything else a desktop.</summary>
        Auto,

        /// <summary>A computer, also one that a headset hangs on.</summary>
        Desktop,

        /// <summary>A phone or tablet.</summary>
        Phone,

        /// <summary>A stand-alone headset.</summary>
        Headset,

        /// <summary>The bounds that the settings themselves state.</summary>
        Custom,
    }
}
