using UnityEngine;

namespace Lpvbake
{
    /// <summary>Lights the scene by a volume, through shaders that include Lpvbake.hlsl.</summary>
    [ExecuteAlways]
    public class LpvbakeLight : MonoBehaviour
    {
        public LpvbakeVolume volume;
        /// <summary>Of the engine's unit of light in a nit; the bake prints an exposure.</summary>
        public float intensity = 1;

        void OnEnable()
        {
            if (volume != null)
                volume.Apply(intensity);
        }

        void OnDisable()
        {
            if (volume != null)
                volume.Apply(0);
        }

        void OnValidate()
        {
            if (isActiveAndEnabled)
                OnEnable();
        }
    }
}
